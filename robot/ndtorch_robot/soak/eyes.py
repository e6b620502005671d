"""Cameras that fail when told to."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Strips
from ndtorch_robot.ports import StereoFrames
from ndtorch_robot.sim.lockstep_world import LockstepWorld

Levels = npt.NDArray[np.float64]

NOISE = 1.0
"""Standard deviation of the noise of good cameras, levels of 255: drawn pictures have none."""

POOL = 1 << 20
"""Values of noise that are drawn once. A picture begins anywhere in them: to draw each value took half of a soak."""

BLUR = 14
"""Pixels over which a blurred picture is smeared."""

PERIOD = 1 / 30
"""Seconds between two frames."""

LATE = 8
"""Steps by which late pictures are late: 0.27 s at 30 a second."""


class FailingCameras:
    """The cameras of a world, with noise, and with faults by name: see `ndtorch_robot.soak.faults`.

    Args:
        world: whose pictures they are.
        seed: of the noise and of which eye fails.

    Attributes:
        fault: what is wrong now, or None.
        stall: seconds for which the loop hangs in its next step.
    """

    def __init__(self, world: LockstepWorld, seed: int) -> None:
        self.world, self.random = world, np.random.default_rng((seed, 7))
        self.pool = np.rint(self.random.normal(0, NOISE, POOL)).astype(np.int16)
        self.fault: str | None = None
        self.stall = 0.0
        self.sides: tuple[int, ...] = (0,)
        self.asked = 0
        self.kept: deque[StereoFrames] = deque(maxlen=LATE + 1)
        self.held: StereoFrames | None = None

    def fail(self, fault: str) -> None:
        """From now on this is wrong."""
        self.fault, self.asked, self.held = fault, 0, self.kept[-1]
        self.sides = ((0,), (1,), (0, 1))[int(self.random.integers(3))]

    def read(self) -> StereoFrames:
        """What both cameras give now."""
        if self.stall:
            stall, self.stall = self.stall, 0.0
            self.world.wait_until(self.world.now() + stall)
        self.asked += 1
        if self.fault == "no frames":
            raise InputError("the left camera gives no frames")
        if self.fault == "one lost frame" and self.asked == 1:  # a camera pair waits for the next one
            self.world.wait_until(self.world.now() + PERIOD)
        if self.kept and self.world.now() <= self.kept[-1].time:  # there is no new picture yet
            self.world.wait_until(self.kept[-1].time + PERIOD)
        frames = self.world.read()
        frames = frames._replace(left=self.noisy(frames.left), right=self.noisy(frames.right))
        self.kept.append(frames)
        return frames if self.fault is None else self.spoiled(frames, self.fault)

    def spoiled(self, frames: StereoFrames, fault: str) -> StereoFrames:
        """Frames with this fault."""
        held = self.held or frames
        if fault == "late":
            return self.kept[0]
        if fault == "both frozen":
            return held._replace(time=frames.time)
        if fault == "swapped":
            return frames._replace(left=frames.right, right=frames.left)
        if fault == "one lost frame" or (fault == "one bad picture" and self.asked > 1):
            return frames
        for side in self.sides:
            name = ("left", "right")[side]
            now, before = getattr(frames, name), getattr(held, name)
            if fault == "frozen":
                eye = before
            elif fault == "frozen but for noise":
                eye = self.changed(before, lambda a: a + self.random.integers(-1, 2, a.shape))
            else:
                eye = self.changed(now, self.shades()[fault])
            frames = frames._replace(**{name: eye})
            if fault == "one upside down":
                break
        return frames

    def shades(self) -> dict[str, Callable[[Levels], Levels]]:
        """What happens to a picture `[C, h, w]`."""
        random = self.random
        return {
            "black": lambda a: np.zeros_like(a),
            "white": lambda a: 254 + random.normal(0, 1, a.shape),
            "grey": lambda a: 128 + random.integers(-1, 2, a.shape).astype(np.float64),
            "one bad picture": lambda a: 128 + random.integers(-1, 2, a.shape).astype(np.float64),
            "fogged": lambda a: 0.1 * a + 0.9 * 190,
            "covered": lambda a: 25 + 35 * np.linspace(0, 1, a.shape[-1]) ** 2 + random.normal(0, 1.5, a.shape),
            "blurred": lambda a: blurred(a) + random.normal(0, NOISE, a.shape),
            "noise": lambda a: random.uniform(0, 255, a.shape),
            "one upside down": lambda a: a[..., ::-1, ::-1],
        }

    def noisy(self, eye: torch.Tensor | Strips) -> Strips:
        """As a real camera gives it."""
        assert isinstance(eye, Strips)
        parts = []
        for part in eye:
            levels = part[0].numpy()
            start = int(self.random.integers(POOL - levels.size))
            noise = self.pool[start : start + levels.size].reshape(levels.shape)
            parts.append(torch.from_numpy(np.clip(levels + noise, 0, 255).astype(np.uint8))[None])
        return Strips(*parts)

    def changed(self, eye: torch.Tensor | Strips, change: Callable[[Levels], Levels]) -> Strips:
        """Both strips of an eye after a change of their levels."""
        assert isinstance(eye, Strips)
        parts = []
        for part in eye:
            levels = change(part[0].numpy().astype(np.float64))
            parts.append(torch.from_numpy(np.clip(np.round(levels), 0, 255).astype(np.uint8))[None])
        return Strips(*parts)

    def close(self) -> None:
        """The world gives itself back."""
        self.world.close()


def blurred(picture: Levels) -> Levels:
    """Out of focus."""
    import cv2

    planes = [cv2.GaussianBlur(np.ascontiguousarray(plane), (0, 0), BLUR) for plane in picture]
    return np.stack(planes)
