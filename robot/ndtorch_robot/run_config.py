"""The file of a robot: body, cameras and limits, and what `ndtorch run` needs; every key carries its unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from ndtorch.navigation import Body, StereoRig
from ndtorch.utils.packages import toml_file
from ndtorch.utils.toml import Strict, read_toml
from ndtorch_robot.bridges import BRIDGES
from ndtorch_robot.camera_monitor import CameraLimits
from ndtorch_robot.link import HOSTED_BOARD, SERIAL, check_link
from ndtorch_robot.navigator_table import NavigatorTable
from ndtorch_robot.safety import SafetyLimits

USUAL = Body()


class BodyTable(Strict):
    """`[body]`: from it all lengths and speeds follow; see `ndtorch.navigation.Body`."""

    length_m: float = Field(USUAL.length_m, gt=0, description="The body has this length, in m.")
    width_m: float = Field(USUAL.width_m, gt=0, description="The body has this width, in m.")
    min_turn_radius_m: float = Field(
        USUAL.min_turn_radius_m,
        ge=0,
        description="The robot turns no more tightly than this, in m; 0 is a differential drive.",
    )
    max_speed_m_per_s: float = Field(
        USUAL.max_speed_m_per_s, gt=0, description="The robot drives no faster than this, in m/s."
    )
    max_acceleration_m_per_s2: float = Field(
        USUAL.max_acceleration_m_per_s2, gt=0, description="The speed changes no faster than this, in m/s^2."
    )
    reaction_s: float = Field(
        USUAL.reaction_s, ge=0, le=1, description="The robot obeys this time after a command, in s."
    )
    camera_height_m: float = Field(0.20, gt=0, description="The cameras are this high above the floor, in m.")
    camera_forward_m: float = Field(
        0.15, description="The cameras are this far in front of the point the robot turns about, in m."
    )
    camera_pitch_deg: float = Field(0.0, ge=-45, le=45, description="The cameras look down by this angle, in degrees.")

    def body(self) -> Body:
        return Body(**self.model_dump(exclude={"camera_height_m", "camera_forward_m", "camera_pitch_deg"}))


class RigTable(Strict):
    """`[rig]`: what a calibration of the cameras gives; see `ndtorch.navigation.StereoRig`."""

    baseline_m: float = Field(0.30, gt=0, description="The cameras are this far apart, in m.")
    focal_px: float = Field(430.0, gt=0, description="The lenses have this focal length, in pixels.")
    width_px: int = Field(640, ge=16, le=8192, description="Images have this width, in pixels.")
    height_px: int = Field(480, ge=16, le=8192, description="Images have this height, in pixels.")
    cx_px: float | None = Field(
        None, description="The optical axis meets this column, in pixels; without a value the middle one."
    )
    cy_px: float | None = Field(
        None, description="The optical axis meets this row, in pixels; without a value the middle one."
    )


class LimitsTable(Strict):
    """`[limits]`: limits of the safety layer; see `ndtorch_robot.safety.SafetyLimits`."""

    speed_m_per_s: float | None = Field(
        None,
        gt=0,
        le=5,
        description="A command of a higher speed is a fault, in m/s; by default 1.2 times cruise speed.",
    )
    curvature_per_m: float | None = Field(
        None, gt=0, description="A command of a tighter curve is a fault, in 1/m; by default what the body can do."
    )
    acceleration_m_per_s2: float | None = Field(
        None, gt=0, description="The speed increases no faster than this, in m/s^2; by default .8 times the body's."
    )
    steering_per_m_per_s: float | None = Field(
        None,
        gt=0,
        description="The curvature changes no faster than this, in 1/m a second; by default lock to lock in .1 s.",
    )
    step_s: float = Field(0.1, gt=0, le=0.12, description="A longer time between two commands is a fault, in s.")
    frame_age_s: float = Field(0.1, gt=0, le=0.2, description="Frames older than this are a fault, in s.")
    recovery_s: float = Field(
        1.0,
        gt=0,
        le=60,
        description="After a passing fault the car drives on once all has been well for this time, in s.",
    )

    def limits(self, body: Body) -> SafetyLimits:
        tightest = body.max_curvature_per_m
        return SafetyLimits(
            min(1.2 * body.cruise_m_per_s, body.max_speed_m_per_s)
            if self.speed_m_per_s is None
            else self.speed_m_per_s,
            tightest if self.curvature_per_m is None else self.curvature_per_m,
            0.8 * body.max_acceleration_m_per_s2 if self.acceleration_m_per_s2 is None else self.acceleration_m_per_s2,
            18 * tightest if self.steering_per_m_per_s is None else self.steering_per_m_per_s,
            self.step_s,
            self.frame_age_s,
            self.recovery_s,
        )


class RobotTable(Strict):
    """The robot: body, cameras and limits."""

    rate_hz: float = Field(30.0, gt=0, le=200, description="The loop takes this number of steps a second, in Hz.")
    body: BodyTable = BodyTable()
    rig: RigTable = RigTable()
    limits: LimitsTable = LimitsTable()

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
        return self.limits.limits(self.body.body())

    def simulated_limits(self, speed: float | None = None) -> SafetyLimits:
        """Without limits of how fast speed and steering may change: the simulated robot has its own."""
        limits, late = self.safety_limits(), max(0.1, 1.5 / self.rate_hz)
        return SafetyLimits(limits.speed if speed is None else speed, limits.curvature, silence=late, age=late)


class NavigationTable(NavigatorTable):
    """`[navigation]`: this key beside the options of `NavigatorOptions`."""

    map_half_size_m: float = Field(
        0.0, ge=0, le=50, description="The map extends this far from the start to each side, in m; 0 makes no map."
    )


class SimulationTable(Strict):
    """`[simulation]`: a simulated world in place of cameras and car.

    The firmware drives it, in this process, or with `link.kind = "simulated-world"` nothing but the loop.
    """

    arena: str = Field("curve", description="The car drives in this arena, a name or a .toml file.")
    seed: int = Field(0, ge=0, lt=2**31, description="Building, textures and start follow from this number.")
    disturbance: str = Field(
        "", description="These disturbances, names or key=number, act on cameras and car; see `ndtorch drive --help`."
    )


class RunConfig(RobotTable):
    """The file of a robot for `ndtorch run`; `--robot` of other commands reads what describes the robot."""

    board_name: str = Field(
        min_length=1, max_length=8, description="Name of the board; its welcome message has room for 8 letters."
    )
    link: Mapping[str, str | int | float | bool] = Field(
        default_factory=dict,
        description="The drive link is of this `kind` (serial by default, hosted-board in a simulated world), with the "
        "keys of its kind; see `ndtorch_robot/link/`.",
    )
    bridges: Mapping[str, Mapping[str, str | int | float | bool]] = Field(
        default_factory=dict, description="Bridges of these kinds run beside the loop, each with the keys of its kind."
    )
    camera_monitor: CameraLimits = CameraLimits()
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
