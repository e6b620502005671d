"""What can be chosen for a simulated drive: one dataclass for Python, TOML files and command lines, without torch."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

from ndtorch.errors import InputError
from ndtorch.navigation.options import OPTION_NAMES, NavigatorOptions

if TYPE_CHECKING:
    from ndtorch_robot.run_config import RunConfig
    from ndtorch_robot.sim.disturbances import Disturbances


@dataclass(frozen=True)
class RobotOptions(NavigatorOptions):
    """The options of a navigator and of the simulated robot that it drives.

    Raises:
        InputError: a value that cannot be used.
    """

    robot: Path | None = None
    """Configuration of a robot, a file or one of robot/configs by name (default: the car of [A])."""
    seed: int = 0
    """Seed of building, textures and start."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.seed < 2**31:
            raise InputError(f"seed must be 0 to 2147483647, got {self.seed}")

    def from_files(self) -> Self:
        """These options below those of the files that they name: of `config`, where there is one, and of `robot`."""
        from ndtorch.utils.toml import check, toml_values

        file = getattr(self, "config", None)
        values = {} if file is None else toml_values(file)
        robot = self.robot or values.get("robot")
        values = navigation_options(Path(robot)) | values if isinstance(robot, str | Path) else values
        checked = check(values, DriveConfig, str(file or robot))
        return replace(self, **{name: getattr(checked, name) for name in values})

    @cached_property
    def robot_config(self) -> RunConfig:
        """The robot; the car of [A] by default."""
        from ndtorch_robot.run_config import RunConfig, read_run_config

        return RunConfig() if self.robot is None else read_run_config(self.robot)


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """Where a drive is recorded and shown."""

    record: Path | None = None
    """New file of a recording, NAME.mcap, for `ndtorch replay`, Foxglove and ROS 2."""
    rrd: Path | None = None
    """File for the rerun viewer; of a simulated drive with full frames."""
    view: str = ""
    """Running rerun viewer to which the drive is sent, ADDRESS or ADDRESS:PORT."""


@dataclass(frozen=True)
class DriveConfig(RobotOptions, Recorded):
    """A simulated drive: these options beside those of robot and navigator.

    Raises:
        InputError: a value that cannot be used.
    """

    arena: str = "hallway"
    """Arena, a name (see `ndtorch arenas`), a .toml file, or the .yaml file of a map of ROS."""
    seconds: float = 60.0
    """Simulated time, s."""
    odometry: Literal["true", "noisy"] = "true"
    """Dead reckoning: exact (true), or 1 % too long with a drift of 0.05 degrees a second (noisy)."""
    disturbance: str = ""
    """Disturbances of cameras and car: names (noise, flicker, pitch-up, ...) or KEY=NUMBER, with commas."""
    out: Path = Path("out/drive")
    """Folder of the results, or the next free one: out/drive-2."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.seconds <= 86400:
            raise InputError(f"seconds must be above 0 and at most 86400, got {self.seconds}")
        _ = self.disturbance_values

    @cached_property
    def disturbance_values(self) -> Disturbances:
        from ndtorch_robot.sim.disturbances import read_disturbances

        return read_disturbances(self.disturbance)

    def single(self, **changes: Any) -> DriveConfig:
        """The options of one drive among those of a command, with changes."""
        return DriveConfig(**{field.name: getattr(self, field.name) for field in fields(DriveConfig)} | changes)


def navigation_options(robot: Path) -> dict[str, Any]:
    """The options of the navigator that the file of a robot sets."""
    from ndtorch.utils.packages import toml_file
    from ndtorch.utils.toml import toml_values

    options = toml_values(toml_file(robot, "ndtorch_robot", "configs")).get("navigation", {})
    return {name: value for name, value in options.items() if name in OPTION_NAMES}
