"""What can be chosen for a drive, from a TOML file and from the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator

from ndtorch.utils.toml import check, read_toml
from ndtorch_robot.navigator_table import NavigatorTable
from ndtorch_robot.sim.disturbances import read_disturbances

RATE = 30.0
"""Frames a second of a simulated drive."""


class DriveConfig(NavigatorTable):
    """The file of a simulated drive: these keys beside the options of `NavigatorOptions`."""

    arena: str = Field("hallway", description="The car drives in this arena, a name or a .toml file.")
    seed: int = Field(0, ge=0, lt=2**31, description="Building, textures and start follow from this number.")
    seconds: float = Field(60.0, gt=0, le=86400, description="The drive takes this simulated time, in s.")
    odometry: Literal["true", "noisy"] = Field("true", description="Dead reckoning is exact (true), or drifts (noisy).")
    walls: Literal["textured", "blank"] = Field("textured", description="Walls are textured or blank.")
    pedestrian: bool = Field(False, description="A box of the size of a person walks to and fro.")
    disturbance: str = Field("", description="These disturbances, names or key=number, act on cameras and car.")
    full_frames: bool = Field(False, description="Full frames are rendered instead of the strips that are read.")
    rrd: Path | None = Field(None, description="The drive is also recorded into this file for the rerun viewer.")
    view: bool = Field(False, description="The rerun viewer shows the drive as it goes.")
    view_at: str | None = Field(None, description="The drive is served to viewers at this ADDRESS or ADDRESS:PORT.")
    out: Path = Field(Path("out/drive"), description="Results are written into this folder.")
    record: Path | None = Field(None, description="The drive is recorded into this new file, NAME.mcap.")

    @field_validator("disturbance")
    @classmethod
    def known_disturbance(cls, text: str) -> str:
        read_disturbances(text)
        return text

    @property
    def rate(self) -> float:
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
