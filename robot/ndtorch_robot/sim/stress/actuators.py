"""Motor and steering: what the car does of what it is told, and when; and what its odometer says of it."""

from __future__ import annotations

from collections import deque

import numpy as np

from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.sim.stress.options import Stress


class Delay:
    """Commands on their way to the wheels.

    Args:
        seconds: that they take.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.queue: deque[tuple[float, DriveCommand]] = deque()

    def put(self, command: DriveCommand, now: float) -> None:
        """A command is sent."""
        self.queue.append((now + self.seconds, command))

    def take(self, now: float) -> DriveCommand | None:
        """The command that has arrived last, if any has since this was last asked."""
        arrived = None
        while self.queue and self.queue[0][0] <= now + 1e-9:
            arrived = self.queue.popleft()[1]
        return arrived

    def clear(self) -> None:
        """Nothing more arrives: the car was stopped."""
        self.queue.clear()


class Odometer:
    """What the wheels say.

    Args:
        stress: of it `scale`, `bend` and `slip`.
        rng: of the slip.
    """

    def __init__(self, stress: Stress, rng: np.random.Generator) -> None:
        self.stress, self.rng = stress, rng
        self.second, self.slip = -1, 0.0

    def says(self, driven: DriveCommand, now: float) -> DriveCommand:
        """Of what was really driven."""
        if self.stress.slip and int(now) != self.second:
            self.second, self.slip = int(now), float(self.rng.uniform(0, self.stress.slip))
        return DriveCommand(driven.speed * (1 + self.stress.scale + self.slip), driven.curvature + self.stress.bend)
