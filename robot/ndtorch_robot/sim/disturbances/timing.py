"""Timing of frames: late, repeated, lost, or at another rate."""

from __future__ import annotations

from collections import deque
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from ndtorch_robot.ports import StereoFrames
from ndtorch_robot.sim.disturbances.registry import CarErrors, Disturbance, Effect


class Timing(Disturbance):
    """Frames that do not arrive when they should.

    Args:
        lost_ratio: This share of the frames never arrives.
        repeated_ratio: This share of the frames is replaced by the one before.
        latency_s: Frames arrive this many seconds after they were taken.
        fps: The cameras take so many frames a second; 0 is the rate of the car.
    """

    presets: ClassVar[dict[str, str]] = {
        "lost": "lost_ratio=0.1",
        "repeated": "repeated_ratio=0.1",
        "latency": "latency_s=0.066",
        "fps-15": "fps=15",
        "fps-60": "fps=60",
    }

    lost_ratio: Annotated[float, Field(ge=0, le=0.9)] = 0.0
    repeated_ratio: Annotated[float, Field(ge=0, le=0.9)] = 0.0
    latency_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    fps: Annotated[float, Field(ge=0, le=120)] = 0.0

    def car(self) -> CarErrors:
        return CarErrors(fps=self.fps)

    def start(self, rng: np.random.Generator) -> Effect:
        return TimingEffect(self, rng)


class TimingEffect(Effect):
    """Frames that have been taken and not yet delivered."""

    def __init__(self, timing: Timing, rng: np.random.Generator) -> None:
        self.timing, self.rng = timing, rng
        self.queue: deque[StereoFrames] = deque()
        self.last: StereoFrames | None = None

    def loses_frame(self) -> bool:
        return bool(self.timing.lost_ratio and self.rng.random() < self.timing.lost_ratio)

    def deliver(self, frames: StereoFrames) -> StereoFrames:
        given = self.delayed(frames) if self.timing.latency_s else frames
        repeated = self.timing.repeated_ratio
        if repeated and self.last is not None and self.rng.random() < repeated:
            given = self.last._replace(time=given.time)
        self.last = given
        return given

    def delayed(self, taken: StereoFrames) -> StereoFrames:
        """The newest frames that are at least `latency_s` old, or the oldest there are."""
        self.queue.append(taken)
        when = taken.time - self.timing.latency_s
        while len(self.queue) > 1 and self.queue[1].time <= when + 1e-9:
            self.queue.popleft()
        return self.queue[0]._replace(time=when)
