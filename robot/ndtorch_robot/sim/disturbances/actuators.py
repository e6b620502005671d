"""Motor, steering and odometer: when the car obeys, and what is measured of what it drives."""

from __future__ import annotations

from collections import deque
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.sim.disturbances.registry import CarErrors, Disturbance, Effect, ErrorRatio, Ratio


class Actuators(Disturbance):
    """Commands that arrive late, and play in the steering.

    Args:
        delay_s: Commands take effect after this many seconds.
        backlash_per_m: The curvature of the wheels may differ from that of the servo by this much, 1/m.
    """

    presets: ClassVar[dict[str, str]] = {"delay": "delay_s=0.15", "backlash": "backlash_per_m=0.3"}

    delay_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    backlash_per_m: Annotated[float, Field(ge=0, le=2)] = 0.0

    def car(self) -> CarErrors:
        return CarErrors(delay=self.delay_s, backlash=self.backlash_per_m)


class Delay:
    """Commands that reach the wheels after `seconds`."""

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.queue: deque[tuple[float, DriveCommand]] = deque()

    def put(self, command: DriveCommand, now: float) -> None:
        self.queue.append((now + self.seconds, command))

    def take(self, now: float) -> DriveCommand | None:
        """The command that has arrived last, if any has since the last call."""
        arrived = None
        while self.queue and self.queue[0][0] <= now + 1e-9:
            arrived = self.queue.popleft()[1]
        return arrived

    def clear(self) -> None:
        self.queue.clear()


class Odometer(Disturbance):
    """An odometer that is wrong.

    Args:
        odometry_scale_ratio: Measured distances are too long by this ratio.
        curvature_bias_per_m: Measured curvatures are too large by this much, 1/m.
        slip_ratio: The wheels spin by up to this ratio of a distance; the ratio changes every second.
    """

    presets: ClassVar[dict[str, str]] = {
        "odometry-scale": "odometry_scale_ratio=0.05",
        "curvature-bias": "curvature_bias_per_m=0.05",
        "slip": "slip_ratio=0.1",
    }

    odometry_scale_ratio: ErrorRatio = 0.0
    curvature_bias_per_m: ErrorRatio = 0.0
    slip_ratio: Ratio = 0.0

    def start(self, rng: np.random.Generator) -> Effect:
        return OdometerEffect(self, rng)


class OdometerEffect(Effect):
    """The slip changes every second."""

    def __init__(self, errors: Odometer, rng: np.random.Generator) -> None:
        self.errors, self.rng = errors, rng
        self.second, self.slip = -1, 0.0

    def odometry(self, driven: DriveCommand, now: float) -> DriveCommand:
        errors = self.errors
        if errors.slip_ratio and int(now) != self.second:
            self.second, self.slip = int(now), float(self.rng.uniform(0, errors.slip_ratio))
        speed = driven.speed * (1 + errors.odometry_scale_ratio + self.slip)
        return DriveCommand(speed, driven.curvature + errors.curvature_bias_per_m)
