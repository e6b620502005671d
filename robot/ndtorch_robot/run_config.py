"""The file of a car for `ndtorch run`; every key carries its unit."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field, model_validator

from ndtorch.utils.packages import toml_file
from ndtorch.utils.toml import Strict, read_toml
from ndtorch_robot.bridges.registry import BRIDGES
from ndtorch_robot.camera_monitor.limits import CameraLimits
from ndtorch_robot.link.registry import HOSTED_BOARD, SERIAL, check_link
from ndtorch_robot.navigator_table import NavigatorTable
from ndtorch_robot.robot_config import RobotTable

OLD_LIMITS = {
    "row_contrast": "row_contrast_levels",
    "field_contrast": "field_contrast_levels",
    "row_relative": "row_contrast_ratio",
    "field_relative": "field_contrast_ratio",
    "sharpness": "sharpness_ratio",
    "noise": "noise_levels",
    "sharp_range": "min_range_levels",
    "softness": "soft_edge_ratio",
    "row_change": "row_change_levels",
    "field_change": "field_change_levels",
    "still": "static_correlation",
    "by_chance": "chance_correlation",
    "swapped": "swapped_sum",
    "mirrored": "mirrored_sum",
    "turns": "min_turns",
    "backwards": "reversed_log_ratio",
}
"""Keys of `[sight]` of version 0.2, and those of `[camera_monitor]`."""


class CameraMonitorTable(CameraLimits):
    """`[camera_monitor]` of a car, which must stop soon."""

    renamed: ClassVar[Mapping[str, str]] = OLD_LIMITS

    patience_s: float = Field(
        0.25, ge=0.05, le=0.4, description="Images must look wrong for this time, in s, before the car stops."
    )


class NavigationTable(NavigatorTable):
    """`[navigation]`: this key beside the options of `NavigatorOptions`."""

    map_half_size_m: float = Field(
        0.0, ge=0, le=50, description="The map extends this far from the start to each side, in m; 0 makes no map."
    )


class SimulationTable(Strict):
    """`[simulation]`: a simulated world in place of cameras and car.

    The firmware drives it, in this process, or with `link.kind = "simulated-world"` nothing but the loop.
    """

    renamed: ClassVar[Mapping[str, str]] = {"stress": "disturbance"}

    arena: str = Field("curve", description="The car drives in this arena, a name or a .toml file.")
    seed: int = Field(0, ge=0, lt=2**31, description="Building, textures and start follow from this number.")
    disturbance: str = Field(
        "", description="These disturbances, names or key=number, act on cameras and car; see `ndtorch drive --help`."
    )


class RunConfig(RobotTable):
    """The file of a robot for `ndtorch run`; `--robot` of other commands reads what describes the robot."""

    renamed: ClassVar[Mapping[str, str]] = {"sight": "camera_monitor"}

    robot: str = Field(min_length=1, max_length=8, description="The board must have this name.")
    link: Mapping[str, str | int | float | bool] = Field(
        default_factory=dict,
        description="The drive link is of this `kind` (serial by default, hosted-board in a simulated world), with the "
        "keys of its kind; see `ndtorch_robot/link/`.",
    )
    bridges: Mapping[str, Mapping[str, str | int | float | bool]] = Field(
        default_factory=dict, description="Bridges of these kinds run beside the loop, each with the keys of its kind."
    )
    camera_monitor: CameraMonitorTable = CameraMonitorTable()
    navigation: NavigationTable = NavigationTable()
    cameras: dict[str, str | int | float] | None = None
    simulation: SimulationTable | None = None

    @model_validator(mode="after")
    def one_world(self) -> RunConfig:
        """Either real cameras or the simulated world, and a link that is known."""
        if (self.cameras is None) == (self.simulation is None):
            raise ValueError("give one of the tables [cameras] and [simulation]")
        if self.simulation is None and "kind" not in self.link and "device" not in self.link:
            raise ValueError("real cameras need a real board: give link.device")
        check_link(self.link_table())
        for name, values in self.bridges.items():
            BRIDGES.checked(name, values, f"bridges.{name}")
        return self

    def link_table(self) -> dict[str, Any]:
        simulated = self.simulation is not None and "device" not in self.link
        return {"kind": HOSTED_BOARD if simulated else SERIAL, **self.link}


def read_run_config(file: Path) -> RunConfig:
    """The file of a robot: a path, or the bare name of one in `robot/configs`."""
    return read_toml(toml_file(file, "ndtorch_robot", "configs"), RunConfig)
