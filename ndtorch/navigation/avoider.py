"""Avoidance alone on plain arrays: the published controller without a tensor in between."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch

from ndtorch.arguments import check_kind
from ndtorch.errors import InputError
from ndtorch.kernels.avoid import avoid
from ndtorch.kernels.switch import switched_on
from ndtorch.navigation.controllers.published import AvoidanceParams, AvoidanceState, PublishedControl
from ndtorch.navigation.rig import StereoRig
from ndtorch.vision.nondirectional import SPEED_SCALE
from ndtorch.vision.temporal import FilterState


class AvoiderState(NamedTuple):
    """State of `Avoider`, arrays that nobody writes any more.

    Attributes:
        low: of the high-pass of both fields, `[2, h, w]` float32.
        machine: the numbers of `AvoidanceState`, `[3]` float64.
    """

    low: Any
    machine: Any


class Avoider:
    """Steers by what both cameras see beside the path, as `PublishedControl` does, for one car: [A fig. 5].

    It is for loops that want nothing else, tens of thousands of steps a second. It takes frames as OpenCV gives them
    and gives plain numbers. Without Numba, torch does the same, more slowly.

    Shapes:
        left, right: uint8 arrays `[H, W, 3]`, `[H, W, 1]` or `[3, H, W]` of the two cameras, both of one kind -> speed
            in m/s and curvature in 1/m. `state=None` begins with this frame.

    Args:
        rig: the camera pair.
        dt: time step, s.
        params: of the controller.

    Raises:
        InputError: frames of another size, type or number of colors.
    """

    def __init__(self, rig: StereoRig, dt: float, params: AvoidanceParams | None = None) -> None:
        self.control = PublishedControl(rig, dt, params)
        rule, quick = self.control.rule, self.control.quick
        assert quick is not None
        self.size, self.shape = (rig.height, rig.width), quick.shape
        fields = self.control.fields
        begun = rule.watching - 1 - round(rule.params.start_time / dt)
        self.where, self.numbers = {}, {}
        for beside in (False, True):
            places = [beside, *(f.top for f in fields), *(f.left for f in fields), begun]
            self.where[beside] = np.array(places, np.int64)
        for colors in (1, 3):
            self.numbers[colors] = np.array([1 / (255 * colors), quick.a, SPEED_SCALE, *rule.numbers[:9]])
        self.settled = np.zeros(3)

    def __call__(
        self, left: Any, right: Any, state: AvoiderState | None = None
    ) -> tuple[tuple[float, float], AvoiderState]:
        check_kind("state", state, AvoiderState)
        shape = left.shape
        if len(shape) != 3 or right.shape != shape or not left.dtype == right.dtype == np.uint8:
            raise InputError(f"left and right must be uint8 frames alike, got {left.dtype} {shape} and {right.shape}")
        beside = shape[:2] == self.size
        colors = shape[2] if beside else shape[0]
        if colors not in (1, 3) or (not beside and shape[1:] != self.size):
            raise InputError(f"frames must be [H, W, C] or [C, H, W] with H, W = {self.size}, got {shape}")
        if not switched_on():
            return self.by_torch(left, right, beside, state)
        if not (left.flags.c_contiguous and right.flags.c_contiguous):
            left, right = np.ascontiguousarray(left), np.ascontiguousarray(right)
        low, machine = np.empty(self.shape, np.float32), np.empty(3)
        before = state or AvoiderState(low, self.settled)
        command = avoid(left, right, self.where[beside], self.numbers[colors], state is None, *before, low, machine)
        return command, AvoiderState(low, machine)

    def by_torch(
        self, left: Any, right: Any, beside: bool, state: AvoiderState | None
    ) -> tuple[tuple[float, float], AvoiderState]:
        """The same by the controller."""
        frames = [torch.from_numpy(np.ascontiguousarray(eye)).unsqueeze(0) for eye in (left, right)]
        frames = [eye.permute(0, 3, 1, 2) if beside else eye for eye in frames]
        with torch.inference_mode():
            before = None if state is None else FilterState(torch.from_numpy(state.low))
            sides, fields = self.control.look(*frames, before)
            machine = None if state is None else AvoidanceState(*torch.from_numpy(state.machine).float().unbind())
            command, after = self.control.rule(sides, machine)
        numbers = np.array([float(part) for part in after])
        return (float(command.speed), float(command.curvature)), AvoiderState(fields.low.numpy(), numbers)
