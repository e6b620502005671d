"""What can be chosen for a drive, from a TOML file and from the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator

from ndtorch.navigation import Body, StereoRig
from ndtorch.navigation.options import OPTION_NAMES
from ndtorch.utils.toml import check, toml_values
from ndtorch_robot.run_config import NavigatorTable, RobotTable, read_run_config
from ndtorch_robot.safety import SafetyLimits
from ndtorch_robot.sim.disturbances import read_disturbances

RATE = 30.0
"""Frames a second of a simulated drive."""

LIMITS = SafetyLimits(0.6, 2.2, step_s=0.1, frame_age_s=0.1)
"""Of the car of [A]."""


class DriveConfig(NavigatorTable):
    """The file of a simulated drive: these keys beside the options of `NavigatorOptions`."""

    robot: RobotTable | None = None
    """Robot that drives, the file of one for `ndtorch run`; the car of [A] by default."""
    arena: str = "hallway"
    """Arena to drive in, a name or a .toml file."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """Number from which building, textures and start follow."""
    seconds: Annotated[float, Field(gt=0, le=86400)] = 60.0
    """Simulated time of the drive, in s."""
    odometry: Literal["true", "noisy"] = "true"
    """Dead reckoning: exact (true), or with drift (noisy)."""
    walls: Literal["textured", "blank"] = "textured"
    """Walls: textured or blank."""
    pedestrian: bool = False
    """A box of the size of a person walks to and fro."""
    disturbance: str = ""
    """Disturbances of cameras and car, names or key=number."""
    full_frames: bool = False
    """Full frames are rendered instead of the strips that are read."""
    rrd: Path | None = None
    """File for the rerun viewer."""
    view: bool = False
    """The rerun viewer shows the drive as it goes."""
    view_at: str | None = None
    """Address at which the drive is served to viewers, ADDRESS or ADDRESS:PORT."""
    out: Path = Path("out/drive")
    """Folder for the results."""
    record: Path | None = None
    """New file for a recording, NAME.mcap."""

    @field_validator("disturbance")
    @classmethod
    def known_disturbance(cls, text: str) -> str:
        read_disturbances(text)
        return text

    @property
    def rate(self) -> float:
        own = RATE if self.robot is None else self.robot.rate_hz
        return read_disturbances(self.disturbance).fps or own

    @property
    def body(self) -> Body:
        return Body() if self.robot is None else self.robot.body.body()

    @property
    def rig(self) -> StereoRig:
        return StereoRig(forward=0.15) if self.robot is None else self.robot.stereo_rig()

    @property
    def limits(self) -> SafetyLimits:
        """Of the safety layer."""
        return LIMITS if self.robot is None else self.robot.simulated_limits()


def load_config(file: Path | None, choices: dict[str, object]) -> DriveConfig:
    """The file's values, overridden by those choices that are not None."""
    values: dict[str, object] = {}
    if file is not None:
        values = toml_values(file)
        check(with_robot(values), DriveConfig, str(file))
    values |= {key: value for key, value in choices.items() if value is not None}
    return check(with_robot(values), DriveConfig, "drive")


def with_robot(values: dict[str, object]) -> dict[str, object]:
    """The same values with the robot of the file that they name, and what that file says of navigation below them."""
    file = values.get("robot")
    if not isinstance(file, str | Path):
        return values
    robot, options = read_robot(Path(file))
    return {**options, **values, "robot": robot.model_dump()}


def read_robot(file: Path) -> tuple[RobotTable, dict[str, object]]:
    """The robot of a file, or of one in `robot/configs`, and the options of the navigator that the file sets."""
    config = read_run_config(file)
    options = config.navigation.model_dump(include=set(OPTION_NAMES), exclude_unset=True)
    return RobotTable(**config.model_dump(include=set(RobotTable.model_fields))), options
