"""Kinds of camera sources, one file each; `ndtorch_robot.cameras.source` finds them by searching this folder."""
