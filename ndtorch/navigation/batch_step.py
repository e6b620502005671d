"""Steps of many cars, one frame of each camera of each, by one kernel."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.kernels.load import kernel
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.navigation.controllers.contract import Command
from ndtorch.navigation.controllers.quick import QuickControl
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.row_ranging import RowRangingState
from ndtorch.navigation.state import NavigatorState, Packed, StepState
from ndtorch.navigation.strips import Strips, check_unit_range
from ndtorch.navigation.whole_step import Stepped, WholeStep
from ndtorch.vision.one_pass import KINDS, image_kind
from ndtorch.vision.temporal import FilterState


def batch_step(
    whole: WholeStep, left: Strips, right: Strips, state: NavigatorState | None, driven: Command | None
) -> Stepped | None:
    """One step of B cars; None where the parts are to do it: as of `WholeStep`, at the start, and while cars learn.

    Args:
        left, right: of frames `[B, 1, C, H, W]`.
        state: of all cars, `[B]`.
        driven: `[B, 1]`.
    """
    quick, frames = whole.quick, (left.field, right.field, left.row, right.row)
    if quick is None or state is None or not all(isinstance(eye, Tensor) for eye in frames):
        return None
    kind, (shape, row) = frames[0].dtype, (frames[0].shape, frames[2].shape)
    if len(shape) != 5 or frames[1].shape != shape or frames[3].shape != row or row[0] != shape[0]:
        return None
    if kind not in KINDS or any(eye.dtype != kind for eye in frames) or not kernels_wanted(*frames):
        return None
    cars = shape[0]
    before = packed(whole, quick, state, cars, image_kind(frames[0]))
    form = whole.form(quick, torch.Size(shape[1:]), torch.Size(row[1:]), kind, (False, False))
    if before is None or form is None or not all(map(quick.ready, before.small)):
        return None
    moved = np.zeros((2, cars))
    if driven is not None:
        if not isinstance(driven, Command) or any(part.shape != (cars, 1) for part in driven):
            return None
        moved[0], moved[1] = (part.flatten().tolist() for part in driven)
        if not np.isfinite(moved).all():
            return None
    return run(whole, quick, frames, form, before, state, driven is not None, moved)


def packed(whole: WholeStep, quick: QuickControl, state: NavigatorState, cars: int, kind: torch.dtype) -> Packed | None:
    """Numbers of all cars, `[B, ...]`; None where the state is another one."""
    if isinstance(state, StepState) and state.packed is not None:
        small = state.packed.small
        fits = small.ndim == 2 and len(small) == cars and torch.from_numpy(small).dtype == kind
        return state.packed if fits else None
    if state.fields is None or state.rows is None or state.pose.x.shape != (cars,):
        return None
    arrays, numbers = quick.take(state.control)
    every, large = [*state.command, *state.pose, *numbers], [state.fields.low, state.rows.rows.low, *arrays]
    if any(part.dtype != kind or not part.is_cpu or len(part) != cars for part in (*every, *large) if part.ndim):
        return None
    wide = 2 * whole.parts.ranging.rig.width
    if any(part.shape != (cars,) for part in every):
        return None
    if [part[0].numel() for part in large] != [math.prod(quick.shape), wide, *quick.sizes]:
        return None
    return Packed(torch.cat([part.flatten(1) for part in large], 1).numpy(), torch.stack(every, 1).numpy())


def run(
    whole: WholeStep,
    quick: QuickControl,
    frames: tuple[Tensor, ...],
    form: tuple[Any, Any],
    before: Packed,
    state: NavigatorState,
    given: bool,
    moved: Any,
) -> Stepped:
    """The step itself."""
    (controller, ranging, reckoning), count, cars = whole.parts, 5 + quick.count, len(before.small)
    width, n, pixels = ranging.rig.width, ranging.features.count, math.prod(quick.shape)
    large = torch.empty(cars, pixels + 2 * width + sum(quick.sizes), dtype=image_kind(frames[0]))
    small = torch.empty(cars, count + 4 + 5 * n, dtype=large.dtype)
    found = torch.empty(cars, n, dtype=torch.bool)
    after, valid = Packed(large.numpy(), small.numpy()), found.numpy()
    eyes = [eye.contiguous().numpy() for eye in frames]
    largest = kernel(quick.cars, (eyes[0].dtype, after.large.dtype)).run(
        *eyes,
        *form,
        reckoning.dt,
        reckoning.drift * reckoning.dt,
        1 + reckoning.scale_error,
        given,
        moved,
        *before,
        *after,
        valid,
        *quick.arrays(after.large.dtype),
    )
    if frames[0].is_floating_point():
        check_unit_range(torch.tensor(largest), frames[0])
    images, rows, *arrays = large.split_with_sizes((pixels, 2 * width, *quick.sizes), 1)
    numbers, sides, speeds, bends, ranged = small.split_with_sizes((count, 2, 1, 1, 5 * n), 1)
    speed, curvature, x, y, heading, *control = numbers.unbind(1)
    distance, left, right, ahead, aside = ranged.reshape(cars, 5, n).unbind(1)
    going = quick.give(arrays, control)
    new = NavigatorState(
        FilterState(images.reshape(cars, *quick.shape)),
        RowRangingState(FilterState(rows.reshape(cars, 2, 1, width)), None),
        going,
        Command(speed, curvature),
        Pose(x, y, heading),
        sides,
        controller.difference(going),
        Ranges(distance, left, right, ahead, aside, found),
        *state[8:],
    )
    return Stepped(new, after, Command(speeds, bends), False)
