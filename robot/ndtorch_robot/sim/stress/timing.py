"""When frames come: late, twice, or never."""

from __future__ import annotations

from collections import deque

import numpy as np

from ndtorch_robot.ports import StereoFrames
from ndtorch_robot.sim.stress.options import Stress


class FrameTiming:
    """Frames on their way from the cameras.

    Args:
        stress: of it `drop`, `repeat` and `late`.
        rng: which frames.
    """

    def __init__(self, stress: Stress, rng: np.random.Generator) -> None:
        self.stress, self.rng = stress, rng
        self.queue: deque[StereoFrames] = deque()
        self.last: StereoFrames | None = None

    def loses(self) -> bool:
        """Whether this frame never comes."""
        return bool(self.stress.drop and self.rng.random() < self.stress.drop)

    def deliver(self, taken: StereoFrames) -> StereoFrames:
        """What comes when these frames were taken."""
        given = self.delayed(taken) if self.stress.late else taken
        if self.stress.repeat and self.last is not None and self.rng.random() < self.stress.repeat:
            given = self.last._replace(time=given.time)
        self.last = given
        return given

    def delayed(self, taken: StereoFrames) -> StereoFrames:
        """The newest frames that are as old as the stress says, or the oldest there are."""
        self.queue.append(taken)
        when = taken.time - self.stress.late
        while len(self.queue) > 1 and self.queue[1].time <= when + 1e-9:
            self.queue.popleft()
        return self.queue[0]._replace(time=when)
