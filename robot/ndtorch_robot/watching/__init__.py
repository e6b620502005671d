"""Judging what the cameras show: asked before every step, and before the first one."""
