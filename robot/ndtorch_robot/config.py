"""What can be chosen for a drive, from a TOML file and from the command line."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator

from ndtorch.navigation import Body, StereoRig
from ndtorch.navigation.options import OPTION_NAMES
from ndtorch.utils.toml import check, toml_values
from ndtorch_robot.navigator_table import NavigatorTable
from ndtorch_robot.run_config import RobotTable, read_run_config
from ndtorch_robot.safety import SafetyLimits
from ndtorch_robot.sim.disturbances import read_disturbances

RATE = 30.0
"""Frames a second of a simulated drive."""

LIMITS = SafetyLimits(speed=0.6, curvature=2.2, silence=0.1, age=0.1)
"""Of the car of [A]."""


class DriveConfig(NavigatorTable):
    """The file of a simulated drive: these keys beside the options of `NavigatorOptions`."""

    robot: RobotTable | None = Field(
        None, description="This robot drives, the file of one for `ndtorch run`; the car of [A] by default."
    )
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
        own = RATE if self.robot is None else self.robot.rate_hz
        return read_disturbances(self.disturbance).car().fps or own

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
        check(robot_of(values), DriveConfig, str(file))
    values |= {key: value for key, value in choices.items() if value is not None}
    return check(robot_of(values), DriveConfig, "drive")


def robot_of(values: dict[str, object]) -> dict[str, object]:
    """The same values with the robot of the file that they name, and what that file says of navigation below them."""
    file = values.get("robot")
    if not isinstance(file, str | Path):
        return values
    robot, options = read_robot(Path(file))
    return {**options, **values, "robot": robot.model_dump()}


def read_robot(file: Path) -> tuple[RobotTable, dict[str, object]]:
    """The robot of a file, or of one in `robot/configs`, and the options of the navigator that the file sets."""
    found = read_run_config(file)
    options = found.navigation.model_dump(include=set(OPTION_NAMES), exclude_unset=True)
    return RobotTable(**found.model_dump(include=set(RobotTable.model_fields))), options
