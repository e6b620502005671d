"""What a file for `ndtorch run` holds; every key carries its unit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, model_validator

from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig
from ndtorch.utils.toml import Strict
from ndtorch_robot.camera_monitor.limits import CameraLimits
from ndtorch_robot.link.registry import HOSTED_BOARD, SERIAL, check_link
from ndtorch_robot.navigator_table import NavigatorTable
from ndtorch_robot.safety import SafetyLimits

Positive = Annotated[float, Field(gt=0)]

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


class RigTable(Strict):
    """`[rig]`: where the cameras are; see `ndtorch.navigation.StereoRig`."""

    baseline_m: Positive = 0.30
    focal_px: Positive = 430.0
    width_px: Annotated[int, Field(ge=16, le=8192)] = 640
    height_px: Annotated[int, Field(ge=16, le=8192)] = 480
    camera_height_m: Positive = 0.20
    forward_m: float = 0.15
    pitch_deg: Annotated[float, Field(ge=-45, le=45)] = 0.0
    cx_px: float | None = None
    cy_px: float | None = None

    def rig(self) -> StereoRig:
        """The camera pair."""
        return StereoRig(
            baseline=self.baseline_m,
            focal=self.focal_px,
            width=self.width_px,
            height=self.height_px,
            camera_height=self.camera_height_m,
            forward=self.forward_m,
            pitch=math.radians(self.pitch_deg),
            cx=self.cx_px,
            cy=self.cy_px,
        )


class LimitsTable(Strict):
    """`[limits]`: what the safety layer lets through; see `robot.safety.SafetyLimits`."""

    speed_m_per_s: Annotated[float, Field(gt=0, le=5)] = 0.6
    curvature_per_m: Annotated[float, Field(gt=0, le=10)] = 2.2
    acceleration_m_per_s2: Positive = 2.0
    steering_per_m_per_s: Positive = 40.0
    step_s: Annotated[float, Field(gt=0, le=0.12)] = 0.1
    frame_age_s: Annotated[float, Field(gt=0, le=0.2)] = 0.1
    recovery_s: Annotated[float, Field(gt=0, le=60)] = 1.0

    def limits(self) -> SafetyLimits:
        """For the safety layer."""
        return SafetyLimits(
            self.speed_m_per_s,
            self.curvature_per_m,
            self.acceleration_m_per_s2,
            self.steering_per_m_per_s,
            self.step_s,
            self.frame_age_s,
            self.recovery_s,
        )


class CameraMonitorTable(CameraLimits):
    """`[camera_monitor]` of a car, which must stop soon."""

    patience_s: float = Field(
        0.25, ge=0.05, le=0.4, description="Images must look wrong for this time, in s, before the car stops."
    )

    @model_validator(mode="before")
    @classmethod
    def not_renamed(cls, values: Any) -> Any:
        """Name the new key of one of version 0.2."""
        for key in OLD_LIMITS.keys() & (values if isinstance(values, dict) else {}):
            raise InputError(f"{key} is now {OLD_LIMITS[key]}")
        return values


class NavigationTable(NavigatorTable):
    """`[navigation]`; beside this key those of `NavigatorOptions`.

    Args:
        map_half_size_m: the map reaches so far from the start, m; 0 makes none.
    """

    map_half_size_m: Annotated[float, Field(ge=0, le=50)] = 0.0


class SimulationTable(Strict):
    """`[simulation]`: a simulated world in place of cameras and car.

    The firmware drives it, in this process, or with `link.kind = "simulated-world"` nothing but the loop.

    Args:
        arena: name of an arena or a `.toml` file.
        seed: of the building, its textures and the starting place.
        disturbance: what is wrong with cameras and car, names or `key=number` of `ndtorch_robot.sim.disturbances`.
    """

    arena: str = "curve"
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    disturbance: str = ""

    @model_validator(mode="before")
    @classmethod
    def renamed(cls, values: Any) -> Any:
        """Answer a key of version 0.2 with the present one."""
        if isinstance(values, dict) and "stress" in values:
            raise InputError("stress is now disturbance")
        return values


class RunConfig(Strict):
    """A car.

    Args:
        robot: name that the board must have.
        rate_hz: steps, and frames, a second.
        link: the table of the drive link: its `kind`, `"serial"` by default and in a simulated world
            `"hosted-board"`, and what links of that kind have to say; see `ndtorch_robot/link/`.
        cameras: the table of the camera pair; checked when the cameras are opened.
    """

    robot: Annotated[str, Field(min_length=1, max_length=8)]
    rate_hz: Annotated[float, Field(gt=0, le=200)] = 30.0
    link: Mapping[str, str | int | float | bool] = Field(default_factory=dict)
    rig: RigTable = RigTable()
    limits: LimitsTable = LimitsTable()
    camera_monitor: CameraMonitorTable = CameraMonitorTable()
    navigation: NavigationTable = NavigationTable()
    cameras: dict[str, str | int | float] | None = None
    simulation: SimulationTable | None = None

    @model_validator(mode="before")
    @classmethod
    def not_renamed(cls, values: Any) -> Any:
        """Name the new table of one of version 0.2."""
        if isinstance(values, dict) and "sight" in values:
            raise InputError("[sight] is now [camera_monitor]")
        return values

    @model_validator(mode="after")
    def one_world(self) -> RunConfig:
        """Either real cameras or the simulated world, and a link that is known."""
        if (self.cameras is None) == (self.simulation is None):
            raise ValueError("give one of the tables [cameras] and [simulation]")
        if self.simulation is None and "kind" not in self.link and "device" not in self.link:
            raise ValueError("real cameras need a real board: give link.device")
        check_link(self.link_table())
        return self

    def link_table(self) -> dict[str, Any]:
        """`[link]` with its kind."""
        simulated = self.simulation is not None and "device" not in self.link
        return {"kind": HOSTED_BOARD if simulated else SERIAL, **self.link}
