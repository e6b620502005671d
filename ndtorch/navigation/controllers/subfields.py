"""What the published controller sees: the speed of the image beside the path."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from ndtorch.errors import InputError
from ndtorch.navigation.rig import Rect, StereoRig
from ndtorch.navigation.strip_kernels import eyes, largest_of_cells, state_fits
from ndtorch.navigation.strips import check_eyes, check_unit_range, grey_pair
from ndtorch.vision.feature_kernels import image_kind
from ndtorch.vision.nondirectional import SPEED_SCALE, NDMin, spatial_maximum
from ndtorch.vision.temporal import FilterState


class SubfieldMotion(nn.Module):
    """Speed of the image beside the path: the largest |ND-min| of a subfield of each camera. [A fig. 5]

    Shapes:
        left, right: frames `[..., T, C, H, W]`, or cut to the subfields, uint8 or float in 0..1, C = 1 or 3
            -> `[..., T, 2]`: left and right estimates in the units of the thresholds of [A], raw output x 20.
        State: the subfields, `[..., 2, h, w]`; `None` settles on the first frame.

    Args:
        rig: the camera pair.
        dt: time step, s.
        fields: the subfields, of one size; `rig.subfields()` by default.
        tau_high: time constant of the high-pass, s.

    Raises:
        InputError: frames that cannot be used (see `grey_pair`), or NaN, infinity or values far beyond 1 in
            them; subfields of two sizes or outside the frame.
    """

    def __init__(
        self,
        rig: StereoRig,
        dt: float,
        fields: tuple[Rect, Rect] | None = None,
        tau_high: float = 0.005,
    ) -> None:
        super().__init__()
        self.fields = fields or rig.subfields()
        self.size = (rig.height, rig.width)
        self.nd_min = NDMin(tau_high, dt)
        sizes = {(r.bottom - r.top, r.right - r.left) for r in self.fields}
        inside = all(0 <= r.top < r.bottom <= rig.height and 0 <= r.left < r.right <= rig.width for r in self.fields)
        if len(sizes) != 1 or not inside:
            raise InputError(f"subfields must be of one size and inside {self.size}, got {self.fields}")

    def forward(self, left: Tensor, right: Tensor, state: FilterState | None = None) -> tuple[Tensor, FilterState]:
        check_eyes(left, right)
        quick = self.by_kernels(left, right, state)
        if quick is not None:
            return quick
        pair = grey_pair(left, right, *self.fields, self.size)
        motion, state = self.nd_min.scan(pair, state, pair.ndim - 4)
        sides = spatial_maximum(motion)
        check_unit_range(sides, left)
        return sides * SPEED_SCALE, state

    def by_kernels(self, left: Tensor, right: Tensor, state: FilterState | None) -> tuple[Tensor, FilterState] | None:
        """One frame by kernels; None where torch is to do it."""
        rect = self.fields[0]
        shape = (2, rect.bottom - rect.top, rect.right - rect.left)
        seen = eyes(left, right, self.fields, self.size) if state_fits(state, left, shape) else None
        if seen is None:
            return None
        sides = torch.empty(1, 2, dtype=image_kind(left))
        state = largest_of_cells(seen, state, left, shape, 1, self.nd_min.a, sides.numpy().reshape(2, 1, 1))
        check_unit_range(sides, left)
        return sides.mul_(SPEED_SCALE), state
