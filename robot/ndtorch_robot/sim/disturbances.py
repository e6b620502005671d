"""Disturbances of a simulated drive: one table of keys, and what they do to frames and odometer during a drive."""

from __future__ import annotations

import contextlib
import math
from collections import deque
from typing import Annotated

import numpy as np
import torch
from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict, check
from ndtorch_robot.ports import DriveCommand, StereoFrames

Degrees = Annotated[float, Field(ge=-10, le=10)]
Ratio = Annotated[float, Field(ge=0, le=1)]
Often = Annotated[float, Field(ge=0, le=0.9)]
ErrorRatio = Annotated[float, Field(ge=-0.5, le=0.5)]
Seconds = Annotated[float, Field(ge=0, le=1)]

EXPOSURE_PERIOD, FLICKER_HZ = 3.0, 100.07
"""Period of swings of exposure, s, and frequency of lamps: at exactly 100 Hz the phase would repeat after 3 frames."""

PRESETS = {
    "noise": "noise_sigma=0.05",
    "exposure": "exposure_ratio=0.5",
    "flicker": "flicker_ratio=0.1",
    "dark": "darkness_ratio=0.85,noise_sigma=0.01",
    "pitch-up": "pitch_deg=-3",
    "pitch-down": "pitch_deg=3",
    "roll": "roll_deg=3",
    "yaw": "yaw_deg=3",
    "right-yaw": "right_yaw_deg=1",
    "baseline": "baseline_error_ratio=0.05",
    "focal": "focal_error_ratio=0.05",
    "lost": "lost_ratio=0.1",
    "latency": "latency_s=0.066",
    "delay": "delay_s=0.15",
    "odometry-scale": "odometry_scale_ratio=0.05",
    "curvature-bias": "curvature_bias_per_m=0.05",
    "slip": "slip_ratio=0.1",
}
"""Single disturbances by name: what `evaluate --disturbance all` drives with, one after the other."""


class Disturbances(Strict):
    """The disturbances of a drive; none by default."""

    pitch_deg: Degrees = 0.0  # rotation of both cameras down
    roll_deg: Degrees = 0.0  # rotation of both cameras to their right side
    yaw_deg: Degrees = 0.0  # rotation of both cameras to the left
    right_yaw_deg: Degrees = 0.0  # rotation of the right camera alone to the left
    baseline_error_ratio: ErrorRatio = 0.0  # how much longer the true baseline is
    focal_error_ratio: ErrorRatio = 0.0  # how much longer the true focal length is
    noise_sigma: Ratio = 0.0  # standard deviation of pixel noise, where white is 1
    exposure_ratio: Ratio = 0.0  # swing of the brightness of both cameras with a period of 3 s
    flicker_ratio: Ratio = 0.0  # swing of the brightness of lamps 100 times a second
    darkness_ratio: Ratio = 0.0  # ratio of the light that is missing
    lost_ratio: Often = 0.0  # ratio of the frames that never arrive
    latency_s: Seconds = 0.0  # age of the frames that arrive
    delay_s: Seconds = 0.0  # time until a command takes effect
    odometry_scale_ratio: ErrorRatio = 0.0  # how much too long measured distances are
    curvature_bias_per_m: ErrorRatio = 0.0  # how much too large measured curvatures are
    slip_ratio: Ratio = 0.0  # largest part of a distance by which the wheels spin; changes every second

    @property
    def odometer(self) -> bool:
        return bool(self.odometry_scale_ratio or self.curvature_bias_per_m or self.slip_ratio)

    def light(self, time: float) -> float:
        """Brightness factor of a frame of this time, s."""
        exposure = 1 + self.exposure_ratio * math.sin(2 * math.pi * time / EXPOSURE_PERIOD)
        flicker = 1 + self.flicker_ratio * math.sin(2 * math.pi * FLICKER_HZ * time)
        return (1 - self.darkness_ratio) * exposure * flicker


def read_disturbances(text: str) -> Disturbances:
    """Disturbances from text: names of `PRESETS` or `key=number`, several with commas; "" is none."""
    values: dict[str, str | float] = {}
    for pair in ",".join(PRESETS.get(part, part) for part in text.split(",") if part).split(",") if text else ():
        key, equals, number = (word.strip() for word in pair.partition("="))
        if not equals:
            raise InputError(f"no disturbance {pair!r}, choose one of {', '.join(PRESETS)}, or KEY=NUMBER")
        values[key] = number
        with contextlib.suppress(ValueError):
            values[key] = float(number)
    return check(values, Disturbances, "disturbance")


class Effects:
    """What disturbances do during one drive; all chance comes from `rng`."""

    def __init__(self, disturbances: Disturbances, rng: np.random.Generator) -> None:
        self.given, self.rng = disturbances, rng
        self.queue: deque[StereoFrames] = deque()
        self.second, self.slip = -1, 0.0

    def image(self, pixels: torch.Tensor, time: float) -> torch.Tensor:
        """A part `[1, 3, h, w]` uint8 of a frame of this time, s, as the sensor gives it."""
        d = self.given
        if not (d.noise_sigma or d.exposure_ratio or d.flicker_ratio or d.darkness_ratio):
            return pixels
        lit = pixels.numpy() * np.float32(d.light(time))
        if d.noise_sigma:
            lit += np.float32(255 * d.noise_sigma) * self.rng.standard_normal(lit.shape, dtype=np.float32)
        return torch.from_numpy(np.clip(lit + 0.5, 0, 255).astype(np.uint8))

    def loses_frame(self) -> bool:
        """Whether this frame never arrives."""
        return bool(self.given.lost_ratio and self.rng.random() < self.given.lost_ratio)

    def deliver(self, frames: StereoFrames) -> StereoFrames:
        """The frames that arrive when these are taken: those as old as the latency."""
        if not self.given.latency_s:
            return frames
        self.queue.append(frames)
        when = frames.time - self.given.latency_s
        while len(self.queue) > 1 and self.queue[1].time <= when + 1e-9:
            self.queue.popleft()
        return self.queue[0]._replace(time=when)

    def odometry(self, driven: DriveCommand, now: float) -> DriveCommand:
        """What the odometer measures of what was driven."""
        d = self.given
        if d.slip_ratio and int(now) != self.second:
            self.second, self.slip = int(now), float(self.rng.uniform(0, d.slip_ratio))
        speed = driven.speed * (1 + d.odometry_scale_ratio + self.slip)
        return DriveCommand(speed, driven.curvature + d.curvature_bias_per_m)
