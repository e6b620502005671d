"""A whole step of a `Navigator` by one kernel: one car, one frame of each camera, the numbers of its parts."""

from __future__ import annotations

from typing import Any, NamedTuple

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


class Stepped(NamedTuple):
    """What a step gives: the parts of `NavigatorState`, and the command `[1]`."""

    fields: FilterState
    rows: RowRangingState
    control: Any
    last: Command
    pose: Pose
    sides: Tensor
    ranges: Ranges
    command: Command


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
        if driven.speed.shape != (1,) or driven.curvature.shape != (1,):
            return None
        before.numbers[0], before.numbers[1] = driven.speed.item(), driven.curvature.item()
    return run(parts, quick, (fields, rows), before, left.field)


def begin(
    parts: Parts, quick: QuickControl, state: Going | None, start: Pose | None, kind: torch.dtype
) -> Before | None:
    """What a step starts from; None where that is of several cars or of another precision."""
    lows: tuple[Tensor, ...] = ()
    if state is None:
        still = torch.zeros((), dtype=kind)
        pose = start or Pose(still, still, still)
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
    kind, width, n, count = image_kind(frames), ranging.rig.width, ranging.features.count, len(before.numbers)
    # The images stay with the state; what is small may be kept for longer, and shall not hold on to them.
    pixels = quick.shape[0] * quick.shape[1] * quick.shape[2]
    sizes, large = [pixels, 2 * width, *quick.sizes], torch.empty(pixels + 2 * width + sum(quick.sizes), dtype=kind)
    small, found = torch.empty(count + 2 + 5 * n, dtype=kind), torch.empty(n, dtype=torch.bool)
    memory = large.split_with_sizes(sizes)
    new_fields, new_rows = memory[0].view(quick.shape), memory[1].view(2, 1, width)
    after = small.numpy()
    new_low = (new_fields.numpy(), new_rows.numpy()[:, 0])
    peaks = kernel(quick.kernel, (fields.frames[0].dtype, after.dtype, fields.frames[0].ndim)).run(
        fields.frames,
        rows.frames,
        (fields.beside, rows.beside),
        (*fields.tops, *fields.lefts, rows.tops[0]),
        (fields.unit, fields.over),
        before.low is None,
        (quick.a, ranging.nd_min.a),
        before.low or new_low,
        new_low,
        ranging.finding,
        ranging.limits,
        ranging.geometry,
        before.numbers,
        (reckoning.dt, reckoning.drift * reckoning.dt, 1 + reckoning.scale_error, SPEED_SCALE),
        after[count + 2 :].reshape(5, n),
        found.numpy(),
        after[count : count + 2],
        after[:count],
        *quick.arguments(after.dtype, before.arrays, [part.numpy() for part in memory[2:]]),
    )
    if frames.is_floating_point():
        for peak in peaks:
            check_unit_range(torch.tensor(peak), frames)
    now, sides, placed = small.split_with_sizes((count, 2, 5 * n))
    speed, curvature, x, y, heading, *control = now.unbind()
    distance, left, right, ahead, aside = placed.view(5, n).unbind()
    return Stepped(
        FilterState(new_fields),
        RowRangingState(FilterState(new_rows), None),
        quick.give(memory[2:], control),
        Command(speed, curvature),
        Pose(x, y, heading),
        sides,
        Ranges(distance, left, right, ahead, aside, found),
        Command(speed.unsqueeze(0), curvature.unsqueeze(0)),
    )


def in_frames(step: Stepped) -> tuple[Ranges, Pose]:
    """Ranges `[1, n]` and poses `[1]` of the one frame."""
    return (
        Ranges(*(part.unsqueeze(0) for part in step.ranges)),
        Pose(*(part.unsqueeze(0) for part in step.pose)),
    )
