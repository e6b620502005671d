"""The file of a robot: body, cameras and limits, and what `ndtorch run` needs; every key carries its unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field, ValidationInfo, field_validator, model_validator

from ndtorch.errors import InputError
from ndtorch.navigation import Body, StereoRig
from ndtorch.navigation.options import OPTION_NAMES, NavigatorOptions, check_option, options_of
from ndtorch.utils.packages import toml_file
from ndtorch.utils.toml import Strict, read_toml, refuse_unknown
from ndtorch_robot.bridges import BRIDGES
from ndtorch_robot.link import HOSTED_BOARD, SERIAL, check_link, read_settings
from ndtorch_robot.safety import SafetyLimits

Positive = Annotated[float, Field(gt=0)]
Pixels = Annotated[int, Field(ge=16, le=8192)]
Settings = Mapping[str, str | int | float | bool]

MAX_LIMITS = {"speed_m_per_s": 5.0, "step_s": 0.12, "frame_age_s": 0.2, "recovery_s": 60.0}
"""Highest values of `[limits]`."""


class Table(Strict):
    """A table whose keys are described by the docstrings below them."""

    model_config = ConfigDict(use_attribute_docstrings=True)


class BodyTable(Table):
    """`[body]`: from it all lengths and speeds follow; see `ndtorch.navigation.Body`."""

    length_m: Positive = Body.length_m
    """Length of the body, in m."""
    width_m: Positive = Body.width_m
    """Width of the body, in m."""
    min_turn_radius_m: Annotated[float, Field(ge=0)] = Body.min_turn_radius_m
    """Tightest turn, in m; 0 is a differential drive."""
    max_speed_m_per_s: Positive = Body.max_speed_m_per_s
    """Highest speed, in m/s."""
    max_acceleration_m_per_s2: Positive = Body.max_acceleration_m_per_s2
    """Fastest change of speed, in m/s^2."""
    reaction_s: Annotated[float, Field(ge=0, le=1)] = Body.reaction_s
    """Time from a command until the robot obeys, in s."""
    camera_height_m: Positive = 0.20
    """Height of the cameras above the floor, in m."""
    camera_forward_m: float = 0.15
    """Distance of the cameras in front of the point the robot turns about, in m."""
    camera_pitch_deg: Annotated[float, Field(ge=-45, le=45)] = 0.0
    """Angle by which the cameras look down, in degrees."""

    def body(self) -> Body:
        return Body(**self.model_dump(exclude={"camera_height_m", "camera_forward_m", "camera_pitch_deg"}))


class RigTable(Table):
    """`[rig]`: what a calibration of the cameras gives; see `ndtorch.navigation.StereoRig`."""

    baseline_m: Positive = 0.30
    """Distance between the cameras, in m."""
    focal_px: Positive = 430.0
    """Focal length of the lenses, in pixels."""
    width_px: Pixels = 640
    """Width of images, in pixels."""
    height_px: Pixels = 480
    """Height of images, in pixels."""
    cx_px: float | None = None
    """Column of the optical axis, in pixels; the middle one by default."""
    cy_px: float | None = None
    """Row of the optical axis, in pixels; the middle one by default."""


class RobotTable(Table):
    """The robot: body, cameras and limits."""

    rate_hz: Annotated[float, Field(gt=0, le=200)] = 30.0
    """Steps of the loop a second, in Hz."""
    body: BodyTable = BodyTable()
    rig: RigTable = RigTable()
    limits: Mapping[str, float] = Field(default_factory=dict)
    """Limits of the safety layer that do not follow from the body; see `SafetyLimits`."""

    @field_validator("limits")
    @classmethod
    def usable(cls, limits: Mapping[str, float]) -> Mapping[str, float]:
        refuse_unknown(limits, SafetyLimits)
        SafetyLimits(**limits)
        for name, most in MAX_LIMITS.items():
            if not 0 < limits.get(name, most) <= most:
                raise InputError(f"{name} must be above 0 and at most {most:g}, got {limits[name]:g}")
        return limits

    def stereo_rig(self) -> StereoRig:
        """The cameras on the body."""
        r, b = self.rig, self.body
        return StereoRig(
            baseline=r.baseline_m,
            focal=r.focal_px,
            width=r.width_px,
            height=r.height_px,
            camera_height=b.camera_height_m,
            forward=b.camera_forward_m,
            pitch=math.radians(b.camera_pitch_deg),
            cx=r.cx_px,
            cy=r.cy_px,
        )

    def safety_limits(self) -> SafetyLimits:
        """The limits of the file; others follow from the body."""
        body = self.body.body()
        derived = {
            "speed_m_per_s": min(1.2 * body.cruise_m_per_s, body.max_speed_m_per_s),
            "curvature_per_m": body.max_curvature_per_m,
            "acceleration_m_per_s2": 0.8 * body.max_acceleration_m_per_s2,
            "steering_per_m_per_s": 18 * body.max_curvature_per_m,
            "step_s": 0.1,
            "frame_age_s": 0.1,
        }
        return SafetyLimits(**derived | dict(self.limits))

    def simulated_limits(self, speed: float | None = None) -> SafetyLimits:
        """Without limits of how fast speed and steering may change: the simulated robot has its own."""
        limits, late = self.safety_limits(), max(0.1, 1.5 / self.rate_hz)
        speed = limits.speed_m_per_s if speed is None else speed
        return SafetyLimits(speed, limits.curvature_per_m, step_s=late, frame_age_s=late)


class NavigatorTable(Table, NavigatorOptions):
    """A table of a file with the options of a navigator among its keys."""

    @field_validator(*OPTION_NAMES)
    @classmethod
    def usable(cls, value: Any, info: ValidationInfo) -> Any:
        check_option(str(info.field_name), value)
        return value

    def options(self) -> NavigatorOptions:
        return options_of({name: getattr(self, name) for name in OPTION_NAMES})


class NavigationTable(NavigatorTable):
    """`[navigation]`: this key beside the options of `NavigatorOptions`."""

    map_half_size_m: Annotated[float, Field(ge=0, le=50)] = 0.0
    """Distance from the start to each side of the map, in m; 0 makes no map."""


class SimulationTable(Table):
    """`[simulation]`: a simulated world in place of cameras and car.

    The firmware drives it, in this process, or with `link.kind = "simulated-world"` nothing but the loop.
    """

    arena: str = "curve"
    """Arena to drive in, a name or a .toml file."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """Number from which building, textures and start follow."""
    disturbance: str = ""
    """Disturbances of cameras and car, names or key=number; see `ndtorch drive --help`."""


class RunConfig(RobotTable):
    """The file of a robot for `ndtorch run`; `--robot` of other commands reads what describes the robot."""

    board_name: Annotated[str, Field(min_length=1, max_length=8)]
    """Name of the board; its welcome message has room for 8 letters."""
    link: Settings = Field(default_factory=dict)
    """Drive link of this `kind` (serial by default, hosted-board in a simulated world), with the keys of its kind; see
    `ndtorch_robot/link/`."""
    bridges: Mapping[str, Settings] = Field(default_factory=dict)
    """Bridges of these kinds beside the loop, each with the keys of its kind."""
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
            read_settings(BRIDGES.find(name), values, f"bridges.{name}")
        return self

    def link_table(self) -> dict[str, Any]:
        simulated = self.simulation is not None and "device" not in self.link
        return {"kind": HOSTED_BOARD if simulated else SERIAL, **self.link}


def read_run_config(file: Path) -> RunConfig:
    """The file of a robot: a path, or the bare name of one in `robot/configs`."""
    return read_toml(toml_file(file, "ndtorch_robot", "configs"), RunConfig)
