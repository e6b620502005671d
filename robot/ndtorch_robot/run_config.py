"""The file of a robot: body, cameras and limits, and what `ndtorch run` needs; every key carries its unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, ValidationInfo, field_validator, model_validator

from ndtorch.errors import InputError
from ndtorch.navigation import Body, StereoRig
from ndtorch.navigation.options import NavigatorOptions
from ndtorch.utils.packages import toml_file
from ndtorch.utils.toml import Strict, read_toml, refuse_unknown
from ndtorch_robot.cameras.source import CameraSettings
from ndtorch_robot.link import SERIAL, SIMULATED_BOARD, check_link
from ndtorch_robot.safety import SafetyLimits

if TYPE_CHECKING:
    from ndtorch_robot.sim.plan import Plan
    from ndtorch_robot.sim.simulation import Simulation

Positive = Annotated[float, Field(gt=0)]
Pixels = Annotated[int, Field(ge=16, le=8192)]
Settings = Mapping[str, str | int | float | bool]

MAX_LIMITS = {"speed_m_per_s": 5.0, "step_s": 0.12, "frame_age_s": 0.2, "recovery_s": 60.0}
"""Highest values of `[limits]`."""


class RigTable(Strict):
    """`[rig]`: what a calibration of the cameras gives, and where they are; see `ndtorch.navigation.StereoRig`."""

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
    camera_height_m: Positive = 0.20
    """Height of the cameras above the floor, in m."""
    camera_forward_m: float = 0.15
    """Distance of the cameras in front of the point the robot turns about, in m."""
    camera_pitch_deg: Annotated[float, Field(ge=-45, le=45)] = 0.0
    """Angle by which the cameras look down, in degrees."""

    @property
    def mounting(self) -> dict[str, float]:
        """Where the cameras are, as `StereoRig` has it."""
        pitch = math.radians(self.camera_pitch_deg)
        return {"camera_height": self.camera_height_m, "forward": self.camera_forward_m, "pitch": pitch}


@dataclass(frozen=True)
class NavigationTable(NavigatorOptions):
    """`[navigation]`: this key beside the options of `NavigatorOptions`."""

    map_half_size_m: float = 0.0
    """Distance from the start to each side of the map, in m; 0 makes no map."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.map_half_size_m <= 50:
            raise InputError(f"map_half_size_m must be 0 to 50, got {self.map_half_size_m}")


class SimulationTable(Strict):
    """`[simulation]`: a simulated world in place of cameras and car.

    A board in Python drives it, with `link.kind = "hosted-board"` the firmware, with `"simulated-world"` no board.
    """

    arena: str = "curve"
    """Arena to drive in, a name, a .toml file, or the .yaml file of a map of ROS."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """Number from which building, textures and start follow."""
    disturbance: str = ""
    """Disturbances of cameras and car, names or key=number; see `ndtorch drive --help`."""


class Ros2Table(Strict):
    """`[ros2]`: topics for ROS 2 beside the loop."""

    domain_id: Annotated[int, Field(ge=0, le=232)] = 0
    """ROS_DOMAIN_ID."""
    peer: Annotated[str, Field(pattern=r"^[\w.:-]+$")] = "127.0.0.1"
    """Address of the other computer; this one alone by default."""


class RunConfig(Strict):
    """The file of a robot for `ndtorch run`; `--robot` of other commands reads body, cameras, limits and navigation."""

    board_name: Annotated[str, Field(min_length=1, max_length=8)] = "maxston8"
    """Name of the board, ROBOT_NAME in the firmware's config.h, up to 8 letters."""
    rate_hz: Annotated[float, Field(gt=0, le=200)] = 30.0
    """Steps of the loop a second, in Hz."""
    body: Body = Body()
    """Body of the robot, with the keys of `ndtorch.navigation.Body`: all lengths and speeds follow from it."""
    rig: RigTable = RigTable()
    limits: Mapping[str, float] = Field(default_factory=dict)
    """Limits of the safety layer that do not follow from the body; see `SafetyLimits`."""
    link: Settings = Field(default_factory=dict)
    """Drive link of this `kind` (default: serial, or simulated-board in a simulated world), with the keys of its kind;
    see `ndtorch_robot/link/`."""
    ros2: Ros2Table | None = None
    navigation: NavigationTable = NavigationTable()
    """Options of the navigator."""
    cameras: CameraSettings | None = None
    simulation: SimulationTable | None = None

    @field_validator("body", "navigation", mode="before")
    @classmethod
    def known_keys(cls, value: Any, info: ValidationInfo) -> Any:
        kind = {"body": Body, "navigation": NavigationTable}[str(info.field_name)]
        if isinstance(value, Mapping):
            refuse_unknown(value, kind)
            return kind(**value)
        return value

    @field_validator("limits")
    @classmethod
    def usable(cls, limits: Mapping[str, float]) -> Mapping[str, float]:
        refuse_unknown(limits, SafetyLimits)
        SafetyLimits(**limits)
        for name, most in MAX_LIMITS.items():
            if not 0 < limits.get(name, most) <= most:
                raise InputError(f"{name} must be above 0 and at most {most:g}, got {limits[name]:g}")
        return limits

    @model_validator(mode="after")
    def one_world(self) -> RunConfig:
        """Not both real cameras and the simulated world, and a link that is known."""
        if self.cameras is not None and self.simulation is not None:
            raise ValueError("give one of the tables [cameras] and [simulation]")
        if self.cameras is not None and not {"kind", "device"} & self.link.keys():
            raise ValueError("real cameras need a real board: give link.device")
        if self.cameras or self.simulation or self.link:
            check_link(self.link_table())
        return self

    def for_run(self) -> RunConfig:
        """The configuration itself; `InputError` without a car to run, real or simulated."""
        if self.cameras is None and self.simulation is None:
            raise InputError("a car to run needs the tables [cameras] and [link], or the table [simulation]")
        return self

    def link_table(self) -> dict[str, Any]:
        simulated = self.simulation is not None and "device" not in self.link
        return {"kind": SIMULATED_BOARD if simulated else SERIAL, **self.link}

    @property
    def stereo_rig(self) -> StereoRig:
        r = self.rig
        return StereoRig(r.baseline_m, r.focal_px, r.width_px, r.height_px, cx=r.cx_px, cy=r.cy_px, **r.mounting)

    @property
    def safety_limits(self) -> SafetyLimits:
        """The limits of the file; others follow from the body."""
        body = self.body
        derived = {
            "speed_m_per_s": min(1.2 * body.cruise_m_per_s, body.max_speed_m_per_s),
            "curvature_per_m": body.max_curvature_per_m,
            "acceleration_m_per_s2": 0.8 * body.max_acceleration_m_per_s2,
            "steering_per_m_per_s": 18 * body.max_curvature_per_m,
            "step_s": 0.1,
            "frame_age_s": 0.1,
        }
        return SafetyLimits(**derived | dict(self.limits))

    @property
    def simulated_limits(self) -> SafetyLimits:
        """Without limits of how fast speed and steering may change: the simulated robot has its own."""
        limits, late = self.safety_limits, max(0.1, 1.5 / self.rate_hz)
        return SafetyLimits(limits.speed_m_per_s, limits.curvature_per_m, step_s=late, frame_age_s=late)

    def simulate(self, plan: Plan, seed: int, **options: Any) -> Simulation:
        """This robot in a simulated building, with further options of `Simulation`."""
        from ndtorch_robot.sim.simulation import Simulation

        return Simulation(plan, seed, rig=self.stereo_rig, rate=self.rate_hz, body=self.body, **options)


def read_run_config(file: Path) -> RunConfig:
    """The file of a robot: a path, or the bare name of one in `robot/configs`."""
    return read_toml(toml_file(file, "ndtorch_robot", "configs"), RunConfig)
