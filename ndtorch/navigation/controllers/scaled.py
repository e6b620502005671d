"""A controller for a body of any size: it reckons in units of the body, and everybody else in metres."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import torch
from torch import nn

from ndtorch.errors import InputError
from ndtorch.navigation.body import Body, rig_in_units
from ndtorch.navigation.controllers.contract import Command, Controller, SensingRequest, Trace
from ndtorch.navigation.controllers.ranging.floor_view import FloorParams
from ndtorch.navigation.controllers.registry import controller_class
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity.stereo_match import Obstacles, ProximityScan
from ndtorch.navigation.stereo.ranging import Ranges
from ndtorch.navigation.stereo.rig import Rect, StereoRig

NO_FLOOR = FloorParams(near_m=1.0, far_m=1.5)
"""What `StereoRig.subfields` shows, for controllers without parameters of the floor."""


def controller_for_body(
    name: str, rig: StereoRig, dt: float, body: Body, params: Any = None, backend: str = "auto"
) -> Controller:
    """The controller of this name, whose lengths follow the body.

    Args:
        params: its parameters; all lengths and speeds among them are those of the car of [A] and become those of the
            body. A goal stays where it is.
    """
    kind, unit = controller_class(name, backend), body.unit_m
    params = kind.Params() if params is None else params
    names = {field.name for field in fields(params)}
    params = slower(params, body.speed_ratio)
    own = rig_in_units(rig, unit)
    if "body" in names:
        params = replace(params, body=body.in_units(), floor=fitted(params.floor, own))
    if "reactive" in names:
        reactive = slower(params.reactive, body.speed_ratio)
        reactive = replace(reactive, body=body.in_units(), floor=fitted(reactive.floor, own))
        params = replace(params, reactive=reactive)
    if "goal" in names and params.goal is not None:
        params = replace(params, goal=(params.goal[0] / unit, params.goal[1] / unit))
    try:
        inner = kind(own, dt, params)
    except InputError as error:
        near = unit * getattr(getattr(params, "reactive", params), "floor", NO_FLOOR).near_m
        why = f"{error} (1 m of these is {unit:.3g} m for this body)" if unit != 1 else str(error)
        if unit != 1 and rig.floor_hint(near):
            why = f"the controller {name!r} of a body of this size needs floor from {near:.2f} m ahead on"
            why = f"{why}{rig.floor_hint(near)}; StereoRanging needs none"
        raise InputError(why) from None
    return inner if unit == 1 else ScaledController(inner, unit)


def fitted(params: FloorParams, rig: StereoRig) -> FloorParams:
    """The floor with no more bands than it has rows in the image."""
    x, y = torch.tensor([params.far_m, params.near_m]), torch.zeros(2)
    far, near = rig.project(x, y, -rig.camera_height)[1].tolist()
    return replace(params, bands=min(params.bands, max(2, math.floor(near) + 1 - math.ceil(far))))


def slower(params: Any, ratio: float) -> Any:
    """Parameters with all their speeds times a ratio."""
    speeds = {field.name: getattr(params, field.name) for field in fields(params) if field.name.endswith("m_per_s")}
    return replace(params, **{name: speed * ratio for name, speed in speeds.items()}) if ratio < 1 else params


class ScaledController(Controller):
    """A controller for lengths in units of so many metres, as one for metres.

    Near obstacles are in units already: the proximity check is made for the rig in units, too.

    Args:
        inner: made for a rig whose lengths are in units.
        unit: m.
    """

    def __init__(self, inner: Controller, unit: float) -> None:
        nn.Module.__init__(self)
        self.inner, self.unit, self.params = inner, unit, inner.params
        self.name, self.modes, self.backend = inner.name, inner.modes, inner.backend  # type: ignore[misc]
        self.has_goals, self.checks_near = inner.has_goals, inner.checks_near  # type: ignore[misc]

    @property
    def fields(self) -> tuple[Rect, Rect]:
        """As `Controller.fields`."""
        return self.inner.fields

    @property
    def trace(self) -> Trace:
        """As `Controller.trace`."""
        return self.inner.trace

    def see(self, frames: Any, state: Any = None) -> tuple[Any, Any]:
        """As `Controller.see`."""
        return self.inner.see(frames, state)

    def sides(self, seen: Any) -> Any:
        """As `Controller.sides`."""
        return self.inner.sides(seen)

    def in_units(self, pose: Pose) -> Pose:
        """A pose in units."""
        return Pose(pose.x / self.unit, pose.y / self.unit, pose.heading)

    def ranges_in_units(self, ranges: Ranges) -> Ranges:
        """Ranges in units."""
        r, unit = ranges, self.unit
        return r._replace(left_range=r.left_range / unit, x=r.x / unit, y=r.y / unit)

    def start(self, seen: Any, pose: Pose) -> Any:
        """As `Controller.start`."""
        return self.inner.start(seen, self.in_units(pose))

    def step(self, seen: Any, ranges: Ranges, pose: Pose, driven: Command, state: Any) -> tuple[Command, Any]:
        """As `Controller.step`."""
        before = Command(driven.speed / self.unit, driven.curvature * self.unit)
        command, state = self.inner.step(seen, self.ranges_in_units(ranges), self.in_units(pose), before, state)
        return Command(command.speed * self.unit, command.curvature / self.unit), state

    def mode(self, state: Any) -> Any:
        """As `Controller.mode`."""
        return self.inner.mode(state)

    def difference(self, state: Any) -> Any:
        """As `Controller.difference`, in m where it is a length."""
        difference = self.inner.difference(state)
        return difference * self.unit if self.inner.trace.unit == "m" else difference

    def on_near_obstacles(self, state: Any, pose: Pose, scan: ProximityScan) -> Any:
        """As `Controller.on_near_obstacles`, with the scan in units."""
        return self.inner.on_near_obstacles(state, self.in_units(pose), scan)

    def sensing_requests(self, state: Any) -> SensingRequest:
        """As `Controller.sensing_requests`."""
        return self.inner.sensing_requests(state)

    def on_extra_ranges(self, state: Any, pose: Pose, ranges: Ranges | None, obstacles: Obstacles | None) -> Any:
        """As `Controller.on_extra_ranges`, with obstacles in units."""
        ranges = None if ranges is None else self.ranges_in_units(ranges)
        return self.inner.on_extra_ranges(state, self.in_units(pose), ranges, obstacles)

    def on_pose(self, state: Any, pose: Pose, place: Pose) -> Any:
        """As `Controller.on_pose`."""
        return self.inner.on_pose(state, self.in_units(pose), self.in_units(place))

    def on_goal(self, state: Any, goal: tuple[float, float]) -> Any:
        """As `Controller.on_goal`."""
        return self.inner.on_goal(state, (goal[0] / self.unit, goal[1] / self.unit))

    def can_resume(self, state: Any) -> bool:
        """As `Controller.can_resume`."""
        return self.inner.can_resume(state)

    def status_message(self, state: Any) -> str | None:
        """As `Controller.status_message`; lengths in it are those of the car of [A]."""
        message = self.inner.status_message(state)
        return None if message is None else f"{message} (1 m is {self.unit:.3g} m for this body)"

    def warm_up(self) -> None:
        """As `Controller.warm_up`."""
        self.inner.warm_up()
