"""Light and sensor: how bright a frame is, and its noise."""

from __future__ import annotations

import math

import numpy as np
import torch

from ndtorch_robot.sim.paint import Image
from ndtorch_robot.sim.stress.options import Stress

SWING = 3.0
"""Period of the swings of exposure, s."""

MAINS = 100.0
"""Times a second at which lamps flicker."""


class Light:
    """What light and sensor do to frames.

    Args:
        stress: of it `noise`, `exposure`, `flicker`, `dark` and, for rows that are read one after the other, `rolling`.
        rng: of the noise.
        height: rows of a frame.
    """

    def __init__(self, stress: Stress, rng: np.random.Generator, height: int) -> None:
        self.stress, self.rng, self.height = stress, rng, height
        self.changes = bool(stress.noise or stress.exposure or stress.flicker or stress.dark)

    def gain(
        self, time: float, rows: np.ndarray[tuple[int], np.dtype[np.float64]]
    ) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Brightness of rows of a frame that was taken at a time, as a factor."""
        s = self.stress
        when = time + s.rolling * (rows / self.height - 0.5)
        swing = 1 + s.exposure * math.sin(2 * math.pi * time / SWING)
        # 100 Hz against 30 frames a second: the phase would repeat after three frames; mains are never that exact.
        flicker = 1 + s.flicker * np.sin(2 * math.pi * (MAINS + 0.07) * when)
        return np.asarray((1 - s.dark) * swing * flicker)

    def frame(self, pixels: torch.Tensor, top: int, time: float) -> torch.Tensor:
        """A part `[1, 3, h, w]` uint8 of a frame as the sensor gives it.

        Args:
            top: its first row.
        """
        if not self.changes:
            return pixels
        rows = top + np.arange(pixels.shape[-2], dtype=np.float64)
        lit = pixels.numpy().astype(np.float32) * self.gain(time, rows).astype(np.float32)[:, None]
        if self.stress.noise:
            lit += np.float32(255 * self.stress.noise) * self.rng.standard_normal(lit.shape, dtype=np.float32)
        seen: Image = np.clip(lit + 0.5, 0, 255).astype(np.uint8)
        return torch.from_numpy(seen)
