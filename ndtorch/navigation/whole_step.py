"""A whole step of a `Navigator` by one kernel: one car, one frame of each camera, the numbers of its parts."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.kernels.switch import kernels_wanted
from ndtorch.navigation.controllers.contract import STOPPED, SUPPRESSED, Command, Controller
from ndtorch.navigation.controllers.quick import QuickControl
from ndtorch.navigation.odometry import DeadReckoning, Pose
from ndtorch.navigation.one_frame import as_array, numpy_kind, one_of
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.row_ranging import RowRanging, RowRangingState
from ndtorch.navigation.state import NavigatorState, Packed, StepState
from ndtorch.navigation.strips import Strips, check_unit_range
from ndtorch.vision.feature_kernels import KINDS, image_kind
from ndtorch.vision.nondirectional import SPEED_SCALE
from ndtorch.vision.temporal import FilterState


class Parts(NamedTuple):
    """Those of a `Navigator` that make a step."""

    controller: Controller
    ranging: RowRanging
    reckoning: DeadReckoning


class Seen(NamedTuple):
    """Two frames as the kernel takes them.

    Attributes:
        eyes: left and right, of the fields and of the rows.
        whole, numbers: what the kernel has to know of them and of the parts.
    """

    eyes: tuple[Any, Any, Any, Any]
    whole: Any
    numbers: Any


class Stepped(NamedTuple):
    """What a step gives.

    Attributes:
        state: all but the memory, which is that of before.
        packed: the numbers of the state.
        command: `[1]`.
        careful: whether the controller's caution has something to say.
    """

    state: NavigatorState
    packed: Packed
    command: Command
    careful: bool


Beginning = Callable[[Command, Any, Pose, bool], Any]
"""What the controller's state becomes before a step that a car begins standing: of the motion before, the state, the
pose of the frame, and whether it is the first one."""


class WholeStep:
    """Steps of these parts, as long as there is a kernel for them."""

    def __init__(self, parts: Parts) -> None:
        self.parts = parts
        self.quick = None if parts.ranging.search or parts.ranging.follow else parts.controller.quick
        self.forms: dict[Any, tuple[Any, Any] | None] = {}

    def __call__(
        self,
        left: Strips,
        right: Strips,
        state: NavigatorState | None,
        driven: Command | None,
        start: Pose | None,
        begin: Beginning | None = None,
    ) -> Stepped | None:
        """One step; None where the parts are to do it: several frames or cars, gradients, a part without a kernel.

        Args:
            begin: what comes before a step that a car begins standing, if anything.
        """
        quick = self.quick
        if quick is None:
            return None
        seen = self.look(quick, left, right)
        if seen is None:
            return None
        moved = (False, 0.0, 0.0)
        if driven is not None:
            if not isinstance(driven, Command) or driven.speed.shape != (1,) or driven.curvature.shape != (1,):
                return None
            moved = (True, driven.speed.item(), driven.curvature.item())
            if not (math.isfinite(moved[1]) and math.isfinite(moved[2])):
                return None
        kind = image_kind(left.field)
        if state is None:
            before = self.first(quick, driven, start, begin, kind)
        else:
            before = self.going_on(quick, state, driven, begin, kind)
        return None if before is None else self.run(quick, seen, before, state, moved, left.field)

    def going_on(
        self,
        quick: QuickControl,
        state: NavigatorState,
        driven: Command | None,
        begin: Beginning | None,
        kind: torch.dtype,
    ) -> Packed | None:
        """What a step goes on from; None where no kernel can."""
        before: Packed | None
        if isinstance(state, StepState) and state.packed is not None:
            small = state.packed.small
            before = state.packed if small.ndim == 1 and numpy_kind(kind) == small.dtype else None
        else:
            before = self.gather(quick, state, kind)
        mode = None if before is None else quick.mode(before.small)
        anew = state.fields is None
        if mode == STOPPED or (begin is not None and (anew or mode == SUPPRESSED)):
            control = state.control
            if begin is not None:
                last = state.command if driven is None else one_of(driven)
                control = begin(last, control, self.parts.reckoning.step(state.pose, *last), anew)
            control = self.parts.controller.woken(control)
            if control is not state.control:
                before = self.gather(quick, state._replace(control=control), kind)
        return before

    def look(self, quick: QuickControl, left: Strips, right: Strips) -> Seen | None:
        """What the kernel sees of frames `[1, C, H, W]`; None where they are none that it takes."""
        frames = (left.field, right.field, left.row, right.row)
        if not all(isinstance(eye, Tensor) for eye in frames):
            return None
        shape, kind, row = frames[0].shape, frames[0].dtype, frames[2].shape
        if frames[1].shape != shape or frames[3].shape != row or not (kind == frames[1].dtype == frames[2].dtype):
            return None
        if frames[3].dtype != kind or not kernels_wanted(*frames):
            return None
        (ours, beside), (theirs, also) = as_array(frames[0]), as_array(frames[1])
        if frames[2] is frames[0] and frames[3] is frames[1]:
            line, other, across, too = ours, theirs, beside, also
        else:
            (line, across), (other, too) = as_array(frames[2]), as_array(frames[3])
        if beside != also or across != too:
            return None
        key = (shape, row, kind, beside, across)
        if key not in self.forms:
            self.forms[key] = self.form(quick, shape, row, kind, (beside, across))
        form = self.forms[key]
        return None if form is None else Seen((ours, theirs, line, other), *form)

    def form(
        self, quick: QuickControl, shape: torch.Size, row: torch.Size, kind: torch.dtype, beside: tuple[bool, bool]
    ) -> tuple[Any, Any] | None:
        """Whole and other numbers of `look_around` for such frames; None where they are none that it takes."""
        controller, ranging, _ = self.parts
        size, fields = (ranging.rig.height, ranging.rig.width), controller.fields
        cut = (fields[0].bottom - fields[0].top, fields[0].right - fields[0].left)
        if len(shape) != 4 or len(row) != 4 or shape[0] != 1 or row[0] != 1 or shape[1] != row[1]:
            return None
        if shape[1] not in (1, 3) or kind not in KINDS:
            return None
        if shape[2:] not in (size, cut) or row[2:] not in (size, (1, size[1])):
            return None
        tops = [rect.top if shape[2:] == size else 0 for rect in fields]
        lefts = [rect.left if shape[2:] == size else 0 for rect in fields]
        lefts = [left + inward for left, inward in zip(lefts, quick.inward, strict=True)]
        top = ranging.row.top if row[2:] == size else 0
        unit, count = (1 / (255 * shape[1]), 1) if kind == torch.uint8 else (1.0, shape[1])
        n, spacing, weakest, difference, reach, border, kept = ranging.finding
        least, most, one_to_one, limit = ranging.limits
        *geometry, exact = ranging.geometry
        whole = [*beside, *tops, *lefts, top, count, *quick.cells, *quick.shape[1:], size[1]]
        whole += [n, spacing, reach, border, *kept, one_to_one, exact, 5 + quick.count]
        numbers = [unit, quick.a, ranging.nd_min.a, SPEED_SCALE, weakest, difference, least, most, limit, *geometry]
        return np.array([*whole, *quick.whole], np.int64), np.array([*numbers, *quick.numbers])

    def first(
        self,
        quick: QuickControl,
        driven: Command | None,
        start: Pose | None,
        begin: Beginning | None,
        kind: torch.dtype,
    ) -> Packed | None:
        """What a car starts from; None where its pose is none of one car."""
        still = torch.zeros((), dtype=kind)
        pose = start or Pose(still, still, still)
        if not isinstance(pose, Pose) or any(not isinstance(part, Tensor) or part.ndim for part in pose):
            return None
        if not all(map(math.isfinite, pose)):
            return None
        rest = Command(still, still)
        control = self.parts.controller.start(still.new_zeros(2), pose)
        if begin is not None:
            last = rest if driven is None else one_of(driven)
            control = begin(last, control, self.parts.reckoning.step(pose, *last), True)
        return self.packed(quick, self.unset(quick, kind), control, rest, pose, kind)

    def unset(self, quick: QuickControl, kind: torch.dtype) -> tuple[Tensor, Tensor]:
        """Fields and rows of filters that begin with the frame to come, which writes them."""
        rows = torch.empty(2, 1, self.parts.ranging.rig.width, dtype=kind)
        return torch.empty(quick.shape, dtype=kind), rows

    def gather(self, quick: QuickControl, state: NavigatorState, kind: torch.dtype) -> Packed | None:
        """What a step goes on from; None where that is of several cars or of another precision."""
        if state.fields is None and state.rows is None:
            # After a fault the filters begin anew.
            return self.packed(quick, self.unset(quick, kind), state.control, state.command, state.pose, kind)
        if state.fields is None or state.rows is None:
            return None
        lows = (state.fields.low, state.rows.rows.low)
        if lows[0].shape != quick.shape or lows[1].shape != (2, 1, self.parts.ranging.rig.width):
            return None
        return self.packed(quick, lows, state.control, state.command, state.pose, kind)

    def packed(
        self,
        quick: QuickControl,
        lows: tuple[Tensor, Tensor],
        control: Any,
        command: Command,
        pose: Pose,
        kind: torch.dtype,
    ) -> Packed | None:
        """Numbers of a state as the kernel takes them."""
        arrays, numbers = quick.take(control)
        every = [*command, *pose, *numbers]
        large = [*lows, *arrays]
        for part in (*every, *large):
            if part.dtype != kind or not part.is_cpu:
                return None
        if any(part.ndim for part in every) or [part.numel() for part in arrays] != [*quick.sizes]:
            return None
        return Packed(torch.cat([part.flatten() for part in large]).numpy(), torch.stack(every).numpy())

    def run(
        self,
        quick: QuickControl,
        seen: Seen,
        before: Packed,
        state: NavigatorState | None,
        moved: tuple[bool, float, float],
        frames: Tensor,
    ) -> Stepped:
        """The step itself."""
        (_, ranging, reckoning), count = self.parts, 5 + quick.count
        width, n, pixels = ranging.rig.width, ranging.features.count, math.prod(quick.shape)
        # The images stay with the state; what is small may be kept for longer, and shall not hold on to them.
        large = torch.empty(pixels + 2 * width + sum(quick.sizes), dtype=image_kind(frames))
        small, found = torch.empty(count + 4 + 5 * n, dtype=large.dtype), torch.empty(n, dtype=torch.bool)
        after = Packed(large.numpy(), small.numpy())
        *peaks, careful = quick.kernel(
            *seen.eyes,
            seen.whole,
            seen.numbers,
            reckoning.dt,
            reckoning.drift * reckoning.dt,
            1 + reckoning.scale_error,
            state is None or state.fields is None,
            *moved,
            *before,
            *after,
            found.numpy(),
            *quick.arrays(after.large.dtype),
        )
        if frames.is_floating_point():
            for peak in peaks:
                check_unit_range(torch.tensor(peak), frames)
        images, rows, *arrays = large.split_with_sizes((pixels, 2 * width, *quick.sizes))
        parts = small.split_with_sizes((count, 2, 1, 1, 5 * n))
        speed, curvature, x, y, heading, *control = parts[0].unbind()
        distance, left, right, ahead, aside = parts[4].view(5, n).unbind()
        going = quick.give(arrays, control)
        memory = state[8:] if state else (None, None, None, None)
        new = NavigatorState(
            FilterState(images.view(quick.shape)),
            RowRangingState(FilterState(rows.view(2, 1, width)), None),
            going,
            Command(speed, curvature),
            Pose(x, y, heading),
            parts[1],
            self.parts.controller.difference(going),
            Ranges(distance, left, right, ahead, aside, found),
            *memory,
        )
        return Stepped(new, after, Command(parts[2], parts[3]), careful)
