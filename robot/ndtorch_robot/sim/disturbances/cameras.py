"""Cameras: optics and shutter, light and sensor noise, and frames that are late, repeated, lost or at another rate."""

from __future__ import annotations

import math
from collections import deque
from typing import Annotated, ClassVar

import numpy as np
import torch
from pydantic import Field

from ndtorch_robot.ports import StereoFrames
from ndtorch_robot.sim.disturbances.registry import CameraErrors, CarErrors, Disturbance, Effect, ErrorRatio, Ratio
from ndtorch_robot.sim.plan import Floats
from ndtorch_robot.sim.procedural_textures import Image

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
