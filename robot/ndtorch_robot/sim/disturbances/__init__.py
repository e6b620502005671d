"""Disturbances of a simulated drive: light, optics, timing of frames, steering, odometry."""

from ndtorch_robot.sim.disturbances.registry import Disturbance, Disturbances, Effect, presets, read_disturbances

__all__ = ["Disturbance", "Disturbances", "Effect", "presets", "read_disturbances"]
