"""Speed of the image in every cell of floor."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ndtorch.navigation.controllers.ranging.floor_view import EVERY, FloorParams, floor_view
from ndtorch.navigation.rig import StereoRig
from ndtorch.navigation.strips import check_unit_range, grey_pair
from ndtorch.vision.nondirectional import SPEED_SCALE, NDMin
from ndtorch.vision.temporal import FilterState


class FloorMotion(nn.Module):
    """Speed of the image in the cells of both subfields: ND-min, largest |output| of each cell.

    Shapes:
        left, right: frames `[..., T, C, H, W]`, or cut to the subfields, as `SubfieldMotion`
            -> `[..., T, 2, bands, blocks]`, left image first, nearest band and outermost block first, in
            the units of the thresholds of [A], raw output x 20.
        State: the pixels read, every second column of the subfields; `None` settles on the first frame.

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
        self.size = (rig.height, rig.width)
        self.nd_min = NDMin(tau_high, dt)

    def forward(self, left: Tensor, right: Tensor, state: FilterState | None = None) -> tuple[Tensor, FilterState]:
        pair = grey_pair(left, right, *self.fields, self.size, EVERY)
        motion, state = self.nd_min(pair, state)
        bands, blocks = self.params.bands, self.params.blocks
        # One dimension after the other: much faster than both at once.
        cells = motion.abs().unflatten(-2, (bands, -1)).amax(-2).unflatten(-1, (blocks, -1)).amax(-1)
        check_unit_range(cells, left)
        ours, theirs = cells.mul(SPEED_SCALE).unbind(-3)
        # From the top row down to the bottom one first: the nearest band shall be the first, the outermost block too.
        return torch.stack((ours.flip(-2), theirs.flip((-2, -1))), -3), state
