"""Disturbances of a simulated drive by name and key: each is one file in this folder."""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
import torch
from pydantic import Field

from ndtorch.errors import InputError, did_you_mean
from ndtorch.utils.toml import Strict, check
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.sim.plan import Floats

Ratio = Annotated[float, Field(ge=0, le=1)]
ErrorRatio = Annotated[float, Field(ge=-0.5, le=0.5)]


class CameraErrors(NamedTuple):
    """How the real cameras differ from the rig that the car knows. Errors of several disturbances add up.

    Attributes:
        pitch, roll, yaw: radians by which both cameras are turned down, to the right side and to the left.
        right_yaw: radians by which the right camera alone is turned to the left.
        baseline, focal: relative errors.
        shutter: time for which the shutter is open, s.
        readout: time from reading the first row of a frame to reading the last one, s.
    """

    pitch: float = 0.0
    roll: float = 0.0
    yaw: float = 0.0
    right_yaw: float = 0.0
    baseline: float = 0.0
    focal: float = 0.0
    shutter: float = 0.0
    readout: float = 0.0


class CarErrors(NamedTuple):
    """Frames a second (0 is the rate of the car), delay of commands, s, and backlash of the steering, 1/m."""

    fps: float = 0.0
    delay: float = 0.0
    backlash: float = 0.0


class Effect:
    """What a disturbance does during one drive. A subclass overrides the methods that it needs."""

    def image(self, pixels: torch.Tensor, time: float, row_times: Floats) -> torch.Tensor:
        """A part `[1, 3, h, w]` uint8 of a frame, taken about `time`, as the sensor gives it; each of its rows was read
        at its own time, s.
        """
        return pixels

    def loses_frame(self) -> bool:
        """Whether this frame never arrives."""
        return False

    def deliver(self, frames: StereoFrames) -> StereoFrames:
        """The frames that arrive when these are taken."""
        return frames

    def odometry(self, driven: DriveCommand, now: float) -> DriveCommand:
        """What the odometer measures of what was driven."""
        return driven


class Disturbance(Strict):
    """A fault of the simulated cameras, car or odometer. Its fields are its keys, and their defaults do nothing.

    Attributes:
        presets: values by name, for `evaluate --disturbance all`.
    """

    presets: ClassVar[dict[str, str]] = {}

    def camera(self) -> CameraErrors:
        """Errors of the cameras that stay the same."""
        return CameraErrors()

    def car(self) -> CarErrors:
        """Errors of the car that stay the same."""
        return CarErrors()

    def start(self, rng: np.random.Generator) -> Effect:
        """Begin a drive."""
        return Effect()


@cache
def disturbances() -> tuple[type[Disturbance], ...]:
    """All kinds of disturbances: the subclasses of `Disturbance` in this folder and those defined before this call."""
    for module in pkgutil.iter_modules([str(Path(__file__).parent)]):
        importlib.import_module(f"{__package__}.{module.name}")
    return tuple(Disturbance.__subclasses__())


def presets() -> dict[str, str]:
    """Single disturbances by name: what `evaluate --disturbance all` drives with, one after the other."""
    return {name: text for kind in disturbances() for name, text in kind.presets.items()}


@dataclass(frozen=True)
class Disturbances:
    """The disturbances of a drive; none by default."""

    parts: tuple[Disturbance, ...] = ()

    @property
    def none(self) -> bool:
        return not self.parts

    def value(self, key: str) -> float:
        """The value of a key; 0 where it is not given."""
        return float(next((getattr(part, key) for part in self.parts if key in type(part).model_fields), 0.0))

    @property
    def odometer(self) -> bool:
        effects = [part.start(np.random.default_rng(0)) for part in self.parts]
        return any(type(effect).odometry is not Effect.odometry for effect in effects)

    def camera(self) -> CameraErrors:
        """Errors of the cameras that stay the same."""
        return CameraErrors(*map(sum, zip(CameraErrors(), *(part.camera() for part in self.parts), strict=True)))

    def car(self) -> CarErrors:
        """Errors of the car that stay the same."""
        return CarErrors(*map(sum, zip(CarErrors(), *(part.car() for part in self.parts), strict=True)))

    def start(self, rng: np.random.Generator) -> list[Effect]:
        """Begin a drive; all chance comes from `rng`."""
        return [part.start(rng) for part in self.parts]


def read_disturbances(text: str) -> Disturbances:
    """Disturbances from text: names of `presets` or `key=number`, several with commas; "" is none."""
    owners = {key: kind for kind in disturbances() for key in kind.model_fields}
    values: dict[type[Disturbance], dict[str, Any]] = {kind: {} for kind in disturbances()}
    for key, number in pairs(text):
        if key not in owners:
            raise InputError(
                f"no key {key!r} of a disturbance, known are {', '.join(owners)}{did_you_mean(key, owners)}"
            )
        values[owners[key]][key] = number
    parts = [check(given, kind, "disturbance") for kind, given in values.items() if given]
    return Disturbances(tuple(part for part in parts if part != type(part)()))


def pairs(text: str) -> list[tuple[str, str]]:
    """Keys and numbers of a text, with presets replaced by what they are."""
    known, found = presets(), []
    for part in filter(None, text.split(",")):
        if part in known:
            found += pairs(known[part])
            continue
        key, equals, number = part.partition("=")
        if not equals:
            raise InputError(f"no disturbance {part!r}, choose one of {', '.join(known)}, or KEY=NUMBER")
        found.append((key.strip(), number.strip()))
    return found
