"""Light and sensor: brightness and noise of frames."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import torch

from ndtorch_robot.sim.disturbances.registry import Disturbance, Effect, Ratio
from ndtorch_robot.sim.plan import Floats
from ndtorch_robot.sim.procedural_textures import Image

EXPOSURE_PERIOD = 3.0
"""Period of the swings of exposure, s."""

FLICKER_HZ = 100.07
"""Frequency of flickering lamps. At exactly 100 Hz the phase would repeat after three of 30 frames a second."""


class Light(Disturbance):
    """Changing brightness and a noisy sensor.

    Args:
        noise_sigma: Every pixel has noise with this standard deviation, where white is 1.
        exposure_ratio: The brightness of both cameras swings by this ratio with a period of 3 s.
        flicker_ratio: Lamps flicker by this ratio 100 times a second.
        darkness_ratio: This share of the light is missing.
    """

    presets: ClassVar[dict[str, str]] = {
        "noise": "noise_sigma=0.05",
        "exposure": "exposure_ratio=0.5",
        "flicker": "flicker_ratio=0.1",
        "dark": "darkness_ratio=0.85,noise_sigma=0.01",
    }

    noise_sigma: Ratio = 0.0
    exposure_ratio: Ratio = 0.0
    flicker_ratio: Ratio = 0.0
    darkness_ratio: Ratio = 0.0

    def start(self, rng: np.random.Generator) -> Effect:
        return LightEffect(self, rng)

    def gain(self, time: float, row_times: Floats) -> Floats:
        """Brightness factors of rows that were read at `row_times` in a frame of `time`."""
        exposure = 1 + self.exposure_ratio * math.sin(2 * math.pi * time / EXPOSURE_PERIOD)
        flicker = 1 + self.flicker_ratio * np.sin(2 * math.pi * FLICKER_HZ * row_times)
        return np.asarray((1 - self.darkness_ratio) * exposure * flicker)


class LightEffect(Effect):
    """Gain, then noise."""

    def __init__(self, light: Light, rng: np.random.Generator) -> None:
        self.light, self.rng = light, rng

    def image(self, pixels: torch.Tensor, time: float, row_times: Floats) -> torch.Tensor:
        lit = pixels.numpy().astype(np.float32) * self.light.gain(time, row_times).astype(np.float32)[:, None]
        if self.light.noise_sigma:
            lit += np.float32(255 * self.light.noise_sigma) * self.rng.standard_normal(lit.shape, dtype=np.float32)
        seen: Image = np.clip(lit + 0.5, 0, 255).astype(np.uint8)
        return torch.from_numpy(seen)
