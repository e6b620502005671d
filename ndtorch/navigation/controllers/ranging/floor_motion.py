"""Speed of the image in every cell of floor, and whether both eyes see one floor there."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from ndtorch.navigation.controllers.ranging.floor_match import floor_match, match_tables
from ndtorch.navigation.controllers.ranging.floor_view import EVERY, FloorParams, floor_view
from ndtorch.navigation.controllers.ranging.light import DARK, LARGEST, SMALLEST, light_gain
from ndtorch.navigation.rig import StereoRig
from ndtorch.navigation.strip_kernels import eyes, largest_of_cells, matched_cells, state_fits
from ndtorch.navigation.strips import check_eyes, check_unit_range, grey_pair
from ndtorch.vision.feature_kernels import image_kind
from ndtorch.vision.nondirectional import SPEED_SCALE, NDMin
from ndtorch.vision.temporal import FilterState

LIMITS = (SMALLEST, LARGEST, DARK)


class FloorMotion(nn.Module):
    """Speed of the image in the cells of both subfields: ND-min, largest |output| of each cell; and `floor_match`.

    A change of the light that all cells share is taken out before, see `light_gain`.

    Shapes:
        left, right: frames `[..., T, C, H, W]`, or cut to the subfields, as `SubfieldMotion`
            -> `[..., T, 4, bands, blocks]`, left image first, nearest band and outermost block first: the speeds of
            both images in the units of the thresholds of [A], raw output x 20, then what both eyes see there.
        State: the pixels of the cells, every second column; `None` settles on the first frame.

    Args:
        rig: the camera pair.
        dt: time step, s.
        params: the cells.
        tau_high: time constant of the high-pass, s.

    Raises:
        InputError: frames that cannot be used, or NaN, infinity or values far beyond 1 in the subfields.
    """

    def __init__(self, rig: StereoRig, dt: float, params: FloorParams | None = None, tau_high: float = 0.005) -> None:
        super().__init__()
        self.params = params or FloorParams()
        self.view = floor_view(rig, self.params)
        self.fields = self.view.rects
        self.tables = match_tables(rig, self.params, self.view)
        wide = self.params.blocks * self.tables.wide
        self.parts = tuple(slice(first, first + wide) for first in self.tables.first)
        self.size = (rig.height, rig.width)
        self.nd_min = NDMin(tau_high, dt)

    def forward(self, left: Tensor, right: Tensor, state: FilterState | None = None) -> tuple[Tensor, FilterState]:
        check_eyes(left, right)
        quick = self.by_kernels(left, right, state)
        if quick is not None:
            return quick
        pair = grey_pair(left, right, *self.fields, self.size, EVERY)
        ours, theirs = pair.unbind(-3)
        cut = torch.stack((ours[..., self.parts[0]], theirs[..., self.parts[1]]), -3)
        bands, blocks = self.params.bands, self.params.blocks
        motion, state = self.motion(cut, state)
        # One dimension after the other: much faster than both at once.
        cells = motion.abs().unflatten(-2, (bands, -1)).amax(-2).unflatten(-1, (blocks, -1)).amax(-1)  # type: ignore[no-untyped-call]
        check_unit_range(cells, left)
        ours, theirs = cells.mul(SPEED_SCALE).unbind(-3)
        # From the top row down to the bottom one first: the nearest band shall be the first, the outermost block too.
        speeds = torch.stack((ours.flip(-2), theirs.flip((-2, -1))), -3)
        return torch.cat((speeds, floor_match(pair, self.tables)), -3), state

    def motion(self, cut: Tensor, state: FilterState | None) -> tuple[Tensor, FilterState]:
        """ND-min of the cells `[..., T, 2, h, w]`; what the filters hold becomes as bright as each new frame."""
        dim, found = cut.ndim - 4, []
        for now in cut.unbind(dim):
            if state is not None:
                gain = light_gain(now, state.low, self.params.bands, self.params.blocks)
                state = FilterState(state.low * gain.view(*gain.shape, 1, 1, 1))
            motion, state = self.nd_min.scan(now.unsqueeze(dim), state, dim)
            found.append(motion)
        assert state is not None
        return torch.cat(found, dim), state

    def by_kernels(self, left: Tensor, right: Tensor, state: FilterState | None) -> tuple[Tensor, FilterState] | None:
        """One frame by kernels; None where torch is to do it."""
        rect, bands, blocks = self.view.cells[0], self.params.bands, self.params.blocks
        shape = (2, rect.bottom - rect.top, (rect.right - rect.left) // EVERY)
        seen = eyes(left, right, self.fields, self.size) if state_fits(state, left, shape) else None
        if seen is None:
            return None
        cells = torch.empty(2, bands, blocks, dtype=image_kind(left))
        first = self.tables.first
        lefts = (seen.lefts[0] + EVERY * first[0], seen.lefts[1] + EVERY * first[1])
        within = seen._replace(lefts=lefts)
        state = largest_of_cells(within, state, left, shape, EVERY, self.nd_min.a, cells.numpy(), lit=LIMITS)
        check_unit_range(cells, left)
        cells.mul_(SPEED_SCALE)
        both = matched_cells(seen, left, (self.fields[0].right - self.fields[0].left) // EVERY, EVERY, self.match())
        return torch.stack((cells[0].flip(-2), cells[1].flip((-2, -1)), *both)).unsqueeze(0), state

    def match(self) -> tuple[Any, ...]:
        """The tables as the kernel `match_cells` takes them."""
        t = self.tables
        return (t.rows.numpy(), t.shift.numpy(), t.first, t.wide, t.tall, t.alike, t.least)
