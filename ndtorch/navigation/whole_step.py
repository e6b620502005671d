"""A whole step of a `Navigator` by one kernel: one car, one frame of each camera, the numbers of its parts."""

from __future__ import annotations

import math
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.kernels.load import kernel
from ndtorch.navigation.controllers.contract import Command, Controller
from ndtorch.navigation.controllers.quick import QuickControl
from ndtorch.navigation.odometry import DeadReckoning, Pose
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.row_ranging import RowRanging, RowRangingState
from ndtorch.navigation.strip_kernels import Eyes, eyes
from ndtorch.navigation.strips import Strips, check_unit_range
from ndtorch.vision.nondirectional import SPEED_SCALE
from ndtorch.vision.one_pass import image_kind
from ndtorch.vision.temporal import FilterState


class Parts(NamedTuple):
    """Those of a `Navigator` that make a step."""

    controller: Controller
    ranging: RowRanging
    reckoning: DeadReckoning


class Going(NamedTuple):
    """The first parts of `NavigatorState`, those that the next step goes on from."""

    fields: FilterState
    rows: RowRangingState
    control: Any
    command: Command
    pose: Pose


class Stepped(NamedTuple):
    """What a step gives.

    Attributes:
        going: what the next step goes on from.
        sides: speed estimates, `[2]`.
        ranges: `[n]`.
        command: `[1]`.
    """

    going: Going
    sides: Tensor
    ranges: Ranges
    command: Command

    @property
    def control(self) -> Any:
        """The controller's state."""
        return self.going.control


class Before(NamedTuple):
    """What a step starts from.

    Attributes:
        numbers: speed and curvature driven, the pose, and those of the controller's state, `[5 + count]`.
        arrays: of the controller's state.
        low: states of the fields `[2, h, w]` and the rows `[2, W]`; None settles them.
    """

    numbers: Any
    arrays: list[Any]
    low: tuple[Any, Any] | None


def whole_step(
    parts: Parts, left: Strips, right: Strips, state: Going | None, driven: Command | None, start: Pose | None
) -> Stepped | None:
    """One step; None where the parts are to do it: several frames or cars, gradients, a part without a kernel."""
    controller, ranging, _ = parts
    quick = controller.quick
    if quick is None or ranging.search is not None or ranging.follow is not None:
        return None
    size = (ranging.rig.height, ranging.rig.width)
    fields = eyes(left.field, right.field, controller.fields, size)
    if fields is None:
        return None
    top = ranging.row.top
    if left.row is left.field and right.row is right.field and left.field.shape[2:] == size:
        rows: Eyes | None = fields._replace(tops=(top, top))
    else:
        rows = eyes(left.row, right.row, (ranging.row, ranging.row), size)
    if rows is None or rows.unit != fields.unit or rows.frames[0].dtype != fields.frames[0].dtype:
        return None
    before = begin(parts, quick, state, start, image_kind(left.field))
    if before is None:
        return None
    if driven is not None:
        if not isinstance(driven, Command) or driven.speed.shape != (1,) or driven.curvature.shape != (1,):
            return None
        speed, curvature = driven.speed.item(), driven.curvature.item()
        if not (math.isfinite(speed) and math.isfinite(curvature)):
            return None
        before.numbers[0], before.numbers[1] = speed, curvature
    return run(parts, quick, (fields, rows), before, left.field)


def begin(
    parts: Parts, quick: QuickControl, state: Going | None, start: Pose | None, kind: torch.dtype
) -> Before | None:
    """What a step starts from; None where that is of several cars or of another precision."""
    lows: tuple[Tensor, ...] = ()
    if state is None:
        still = torch.zeros((), dtype=kind)
        pose = start or Pose(still, still, still)
        if not isinstance(pose, Pose) or any(not isinstance(part, Tensor) or part.ndim for part in pose):
            return None
        if not all(map(math.isfinite, pose)):
            return None
        last, control = Command(still, still), parts.controller.start(still.new_zeros(2), pose)
    else:
        last, pose, control = state.command, state.pose, state.control
        lows = (state.fields.low, state.rows.rows.low)
        if lows[0].shape != quick.shape or lows[1].shape != (2, 1, parts.ranging.rig.width):
            return None
    arrays, numbers = quick.take(control)
    every = [*last, *pose, *numbers]
    for part in (*every, *arrays, *lows):
        if part.dtype != kind or not part.is_cpu:
            return None
    if any(part.ndim for part in every) or [part.numel() for part in arrays] != [*quick.sizes]:
        return None
    low = (lows[0].contiguous().numpy(), lows[1].contiguous().numpy()[:, 0]) if lows else None
    return Before(torch.stack(every).numpy(), [part.contiguous().numpy() for part in arrays], low)


def run(parts: Parts, quick: QuickControl, seen: tuple[Eyes, Eyes], before: Before, frames: Tensor) -> Stepped:
    """The step itself."""
    (_, ranging, reckoning), (fields, rows) = parts, seen
    width, n, count = ranging.rig.width, ranging.features.count, len(before.numbers)
    pixels = math.prod(quick.shape)
    # The images stay with the state; what is small may be kept for longer, and shall not hold on to them.
    large = np.empty(pixels + 2 * width + sum(quick.sizes), before.numbers.dtype)
    small, found = np.empty(count + 4 + 5 * n, large.dtype), np.empty(n, np.bool_)
    images = large[:pixels].reshape(quick.shape), large[pixels : pixels + 2 * width].reshape(2, width)
    ends = list(accumulate(quick.sizes, initial=pixels + 2 * width))
    arrays = [large[a:b] for a, b in pairwise(ends)]
    after, sides, ranges = small[:count], small[count : count + 2], small[count + 4 :].reshape(5, n)
    peaks = kernel(quick.kernel, (fields.frames[0].dtype, large.dtype, fields.frames[0].ndim)).run(
        fields.frames,
        rows.frames,
        (fields.beside, rows.beside),
        (*fields.tops, *fields.lefts, rows.tops[0]),
        (fields.unit, fields.over),
        before.low is None,
        (quick.a, ranging.nd_min.a),
        before.low or images,
        images,
        ranging.finding,
        ranging.limits,
        ranging.geometry,
        before.numbers,
        (reckoning.dt, reckoning.drift * reckoning.dt, 1 + reckoning.scale_error, SPEED_SCALE),
        ranges,
        found,
        sides,
        after,
        *quick.arguments(large.dtype, before.arrays, arrays),
    )
    if frames.is_floating_point():
        for peak in peaks:
            check_unit_range(torch.tensor(peak), frames)
    small[count + 2 : count + 4] = after[:2]
    speed, curvature, x, y, heading, *control = torch.from_numpy(after).unbind()
    distance, left, right, ahead, aside = torch.from_numpy(ranges).unbind()
    seen_fields, seen_rows = torch.from_numpy(images[0]), torch.from_numpy(images[1].reshape(2, 1, width))
    going = Going(
        FilterState(seen_fields),
        RowRangingState(FilterState(seen_rows), None),
        quick.give([torch.from_numpy(part) for part in arrays], control),
        Command(speed, curvature),
        Pose(x, y, heading),
    )
    now = torch.from_numpy(small[count : count + 4]).split_with_sizes((2, 1, 1))
    return Stepped(
        going, now[0], Ranges(distance, left, right, ahead, aside, torch.from_numpy(found)), Command(now[1], now[2])
    )


def in_frames(step: Stepped) -> tuple[Ranges, Pose]:
    """Ranges `[1, n]` and poses `[1]` of the one frame."""
    return (
        Ranges(*(part.unsqueeze(0) for part in step.ranges)),
        Pose(*(part.unsqueeze(0) for part in step.going.pose)),
    )
