"""Optics and shutter: cameras that differ from the rig that the car knows, motion blur and a rolling shutter."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from pydantic import Field

from ndtorch_robot.sim.disturbances.registry import CameraErrors, Disturbance, ErrorRatio

Degrees = Annotated[float, Field(ge=-10, le=10)]


class Optics(Disturbance):
    """Errors of mounting, lens and shutter.

    Args:
        pitch_deg: Both cameras are turned down by these degrees.
        roll_deg: Both cameras are turned to their right side by these degrees.
        yaw_deg: Both cameras are turned to the left by these degrees.
        right_yaw_deg: The right camera alone is turned to the left by these degrees.
        baseline_error_ratio: The true baseline is longer by this ratio than the one that the car knows.
        focal_error_ratio: The true focal length is longer by this ratio than the one that the car knows.
        shutter_s: The shutter is open for these seconds, which blurs what moves.
        readout_s: The rows of a frame are read one after the other within these seconds.
    """

    presets: ClassVar[dict[str, str]] = {
        "blur": "shutter_s=0.02",
        "rolling": "readout_s=0.03",
        "pitch-up": "pitch_deg=-3",
        "pitch-down": "pitch_deg=3",
        "roll": "roll_deg=3",
        "yaw": "yaw_deg=3",
        "right-yaw": "right_yaw_deg=1",
        "baseline": "baseline_error_ratio=0.05",
        "focal": "focal_error_ratio=0.05",
    }

    pitch_deg: Degrees = 0.0
    roll_deg: Degrees = 0.0
    yaw_deg: Degrees = 0.0
    right_yaw_deg: Degrees = 0.0
    baseline_error_ratio: ErrorRatio = 0.0
    focal_error_ratio: ErrorRatio = 0.0
    shutter_s: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    readout_s: Annotated[float, Field(ge=0, le=0.1)] = 0.0

    def camera(self) -> CameraErrors:
        degrees = (self.pitch_deg, self.roll_deg, self.yaw_deg, self.right_yaw_deg)
        others = (self.baseline_error_ratio, self.focal_error_ratio, self.shutter_s, self.readout_s)
        return CameraErrors._make((*map(math.radians, degrees), *others))
