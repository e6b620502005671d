"""What can be chosen for a drive, from a TOML file and from the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator

from ndtorch.utils.toml import check, read_toml
from ndtorch_robot.navigator_table import NavigatorTable
from ndtorch_robot.sim.disturbances import read_disturbances

RATE = 30.0
"""Frames a second of a simulated drive."""


class DriveConfig(NavigatorTable):
    """A drive; beside these keys those of `NavigatorOptions`.

    Args:
        arena: name of an arena (`ndtorch arenas`) or a `.toml` file.
        seed: of the building, its textures and the starting place.
        seconds: simulated time, s.
        odometry: `"true"` or `"noisy"` dead reckoning.
        walls: `"textured"` or `"blank"`.
        pedestrian: with a box of the size of a person that walks to and fro.
        disturbance: what is wrong with cameras and car, names or `key=number` of `ndtorch_robot.sim.disturbances`.
        full_frames: render full frames instead of the strips that are read.
        rrd: file for a recording to look at with rerun.
        view: open the rerun viewer and show the drive as it goes.
        view_at: serve the same at this address, for viewers elsewhere.
        out: folder for the results.
        record: new folder for a recording, docs/file-formats.md.
        record_format: frames of the recording, `"png"`, `"jpeg"` or `"raw"`.
    """

    arena: str = "hallway"
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    seconds: Annotated[float, Field(gt=0, le=86400)] = 60.0
    odometry: Literal["true", "noisy"] = "true"
    walls: Literal["textured", "blank"] = "textured"
    pedestrian: bool = False
    disturbance: str = ""
    full_frames: bool = False
    rrd: Path | None = None
    view: bool = False
    view_at: str | None = None
    out: Path = Path("out/drive")
    record: Path | None = None
    record_format: Literal["png", "jpeg", "raw"] = "png"

    @field_validator("disturbance")
    @classmethod
    def known_disturbance(cls, text: str) -> str:
        """What can be read."""
        read_disturbances(text)
        return text

    @property
    def rate(self) -> float:
        """Frames a second."""
        return read_disturbances(self.disturbance).car().fps or RATE


def load_config(file: Path | None, choices: dict[str, object]) -> DriveConfig:
    """The file's values, overridden by those choices that are not None.

    Raises:
        InputError: an unknown key, with the nearest known one, or a value that cannot be used.
    """
    values: dict[str, object] = {}
    if file is not None:
        values = read_toml(file, DriveConfig).model_dump(exclude_unset=True)
    values |= {key: value for key, value in choices.items() if value is not None}
    return check(values, DriveConfig, "drive")
