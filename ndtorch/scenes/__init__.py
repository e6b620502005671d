"""Frames to feed the front end: simulated scenes and real video."""
