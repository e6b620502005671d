"""Simulated cameras with noise, and with faults by name."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Strips
from ndtorch_robot.link.simulated import SimulatedDrive
from ndtorch_robot.ports import StereoFrames

Levels = npt.NDArray[np.float64]

NOISE, POOL = 1.0, 1 << 20
"""Standard deviation of the noise of good cameras, levels of 255, and values that are drawn once."""

PERIOD, DELAY_FRAMES = 1 / 30, 8
"""Seconds between two frames, and frames by which late frames are late."""


class FaultyCameras:
    """The cameras of a simulated world; the seed is that of the noise and of which camera fails.

    Attributes:
        fault: the present fault of `tests.fault_injection.faults`, or None.
        stall: seconds for which the loop hangs in its next step.
        sides: cameras that the fault concerns, 0 for the left one.
    """

    def __init__(self, world: SimulatedDrive, seed: int) -> None:
        self.world, self.random = world, np.random.default_rng((seed, 7))
        self.pool = np.rint(self.random.normal(0, NOISE, POOL)).astype(np.int16)
        self.fault: str | None = None
        self.stall = 0.0
        self.sides: tuple[int, ...] = (0,)
        self.reads = 0
        self.recent: deque[StereoFrames] = deque(maxlen=DELAY_FRAMES + 1)
        self.held: StereoFrames | None = None

    def inject(self, fault: str) -> None:
        """Begin a fault, of the left, the right or both cameras."""
        self.fault, self.reads, self.held = fault, 0, self.recent[-1]
        self.sides = ((0,), (1,), (0, 1))[int(self.random.integers(2 if fault == "unequal light" else 3))]

    def read(self) -> StereoFrames:
        """The frames of both cameras, with the present fault."""
        if self.stall:
            stall, self.stall = self.stall, 0.0
            self.world.wait_until(self.world.now() + stall)
        self.reads += 1
        if self.fault == "no frames":
            raise InputError("the left camera gives no frames")
        if self.fault == "one lost frame" and self.reads == 1:  # a camera pair waits for the next one
            self.world.wait_until(self.world.now() + PERIOD)
        if self.recent and self.world.now() <= self.recent[-1].time:  # there is no new frame yet
            self.world.wait_until(self.recent[-1].time + PERIOD)
        frames = self.world.read()
        frames = frames._replace(left=self.with_noise(frames.left), right=self.with_noise(frames.right))
        self.recent.append(frames)
        return frames if self.fault is None else self.corrupted(frames, self.fault)

    def corrupted(self, frames: StereoFrames, fault: str) -> StereoFrames:
        held = self.held or frames
        if fault == "late":
            return self.recent[0]
        if fault == "both frozen":
            return held._replace(time=frames.time)
        if fault == "one lost frame" or (fault == "one grey frame" and self.reads > 1):
            return frames
        for side in self.sides:
            name = ("left", "right")[side]
            now, before = getattr(frames, name), getattr(held, name)
            image = before if fault == "frozen" else changed(now, self.changes()[fault])
            frames = frames._replace(**{name: image})
        return frames

    def changes(self) -> dict[str, Callable[[Levels], Levels]]:
        """What each fault does to an image `[C, h, w]`."""
        random = self.random
        return {
            "black": lambda a: np.zeros_like(a),
            "white": lambda a: 254 + random.normal(0, 1, a.shape),
            "grey": lambda a: 128 + random.integers(-1, 2, a.shape).astype(np.float64),
            "one grey frame": lambda a: 128 + random.integers(-1, 2, a.shape).astype(np.float64),
            "fogged": lambda a: 0.1 * a + 0.9 * 190,
            "covered": lambda a: 25 + 35 * np.linspace(0, 1, a.shape[-1]) ** 2 + random.normal(0, 1.5, a.shape),
            "unequal light": lambda a: a / 5,
        }

    def with_noise(self, image: torch.Tensor | Strips) -> Strips:
        def noisy(levels: Levels) -> Levels:
            start = int(self.random.integers(POOL - levels.size))
            noisy_levels: Levels = levels + self.pool[start : start + levels.size].reshape(levels.shape)
            return noisy_levels

        return changed(image, noisy)

    def close(self) -> None:
        self.world.close()


def changed(image: torch.Tensor | Strips, change: Callable[[Levels], Levels]) -> Strips:
    """Both strips of a camera, their levels changed and rounded."""
    assert isinstance(image, Strips)
    parts = []
    for part in image:
        levels = change(part[0].numpy().astype(np.float64))
        parts.append(torch.from_numpy(np.clip(np.round(levels), 0, 255).astype(np.uint8))[None])
    return Strips(*parts)
