"""All stresses of a simulated drive in one description, for files and command lines."""

from __future__ import annotations

from types import MappingProxyType
from typing import Annotated, Any

from pydantic import Field, model_validator

from ndtorch.errors import InputError
from ndtorch.toml import Strict, check

Share = Annotated[float, Field(ge=0, le=1)]
Degrees = Annotated[float, Field(ge=-10, le=10)]
Error = Annotated[float, Field(ge=-0.5, le=0.5)]


class Stress(Strict):
    """What is wrong with the cameras, the car and its odometer; nothing by default.

    Args:
        noise: standard deviation of the noise of every pixel, as a share of white.
        exposure: swings of the brightness of both cameras, as a share, with a period of 3 s.
        flicker: the same from lamps, 100 times a second.
        dark: share of the light that is missing.
        blur: seconds for which the shutter is open.
        rolling: seconds from reading the first row of a frame to reading the last one.
        pitch, roll, yaw: degrees by which both cameras are turned down, to the right side and to the left.
        turned: degrees by which the right camera alone is turned to the left.
        baseline, focal: true length less the one that the car was told, as a share of that.
        drop: share of the frames that never come.
        repeat: share of the frames that come a second time in place of the next.
        late: age of the frames when they come, s.
        fps: frames a second; 0 is the rate of the car.
        delay: seconds until the car does what it is told.
        slack: curvature by which the wheels may be off before they follow, 1/m.
        scale: odometer: length as a share too long.
        bend: odometer: curvature that it sees too much, 1/m.
        slip: odometer: the wheels spin, up to so much of a length, another share every second.
    """

    noise: Share = 0.0
    exposure: Share = 0.0
    flicker: Share = 0.0
    dark: Share = 0.0
    blur: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    rolling: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    pitch: Degrees = 0.0
    roll: Degrees = 0.0
    yaw: Degrees = 0.0
    turned: Degrees = 0.0
    baseline: Error = 0.0
    focal: Error = 0.0
    drop: Annotated[float, Field(ge=0, le=0.9)] = 0.0
    repeat: Annotated[float, Field(ge=0, le=0.9)] = 0.0
    late: Annotated[float, Field(ge=0, le=1)] = 0.0
    fps: Annotated[float, Field(ge=0, le=120)] = 0.0
    delay: Annotated[float, Field(ge=0, le=1)] = 0.0
    slack: Annotated[float, Field(ge=0, le=2)] = 0.0
    scale: Error = 0.0
    bend: Error = 0.0
    slip: Share = 0.0

    @model_validator(mode="before")
    @classmethod
    def old_name(cls, values: Any) -> Any:
        """What version 0.1 called otherwise."""
        if isinstance(values, dict) and "rate" in values:
            raise InputError("rate is gone: it is called fps now")
        return values

    @property
    def none(self) -> bool:
        """Whether nothing is wrong."""
        return self == Stress()

    @property
    def odometer(self) -> bool:
        """Whether the odometer is off."""
        return bool(self.scale or self.bend or self.slip)


STRESSES = MappingProxyType(
    {
        "noise": "noise=0.05",
        "exposure": "exposure=0.5",
        "flicker": "flicker=0.1",
        "dark": "dark=0.85,noise=0.01",
        "blur": "blur=0.02",
        "rolling": "rolling=0.03",
        "pitch-up": "pitch=-3",
        "pitch-down": "pitch=3",
        "roll": "roll=3",
        "yaw": "yaw=3",
        "turned": "turned=1",
        "baseline": "baseline=0.05",
        "focal": "focal=0.05",
        "dropped": "drop=0.1",
        "repeated": "repeat=0.1",
        "late": "late=0.066",
        "fps-15": "fps=15",
        "fps-60": "fps=60",
        "delay": "delay=0.15",
        "slack": "slack=0.3",
        "odometry-scale": "scale=0.05",
        "odometry-bend": "bend=0.05",
        "slip": "slip=0.1",
    }
)
"""Single stresses by name: what `evaluate --stress all` drives with, one after the other."""


def read_stress(text: str) -> Stress:
    """A stress from text: a name of `STRESSES`, or `key=number` of `Stress`, several with commas; "" is none.

    Raises:
        InputError: an unknown name or key, or a number out of range.
    """
    values: dict[str, object] = {}
    for part in filter(None, text.split(",")):
        if part in STRESSES:
            values |= read_stress(STRESSES[part]).model_dump(exclude_unset=True)
            continue
        key, equals, number = part.partition("=")
        if not equals:
            raise InputError(f"no stress {part!r}, choose one of {', '.join(STRESSES)}, or KEY=NUMBER")
        values[key.strip()] = number.strip()
    return check(values, Stress, "stress")
