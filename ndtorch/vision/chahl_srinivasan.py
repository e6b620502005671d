"""Shift of a whole row between two frames, by image interpolation."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_number
from ndtorch.errors import InputError
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.frames import trial_by_trial
from ndtorch.vision.temporal import check_series


@safe_state
class ShiftState(NamedTuple):
    """State of `ChahlSrinivasan`: the last frame, `[..., C, H, W]`."""

    last: Tensor


def row_shift(earlier: Tensor, later: Tensor, min_contrast: float = 1e-3) -> Tensor:
    """Shift in pixels that turns `earlier` into `later`, positive to the right. [A §2.1]

    After Chahl and Srinivasan as modified by Zufferey and Floreano:
    the later row is explained as the earlier one plus `s / 2` times the difference between its copies shifted
    one pixel right and one pixel left; least squares over all pixels that have both neighbours gives
    `s = 2 sum((later - earlier)(right - left)) / sum((right - left)^2)`.
    Exact for ramps, within 0.1 pixel on square gratings up to a shift of 1, too small beyond.

    Args:
        earlier, later: `[..., C, H, W]`, W >= 3; one shift is found for all channels and rows together.
        min_contrast: where the root mean square of `right - left` is below this, there is nothing to see
            and the shift is 0.
    Returns:
        `[...]` in pixels.

    >>> ramp = torch.arange(8.0).expand(1, 1, 8)
    >>> float(row_shift(ramp, ramp - 0.5))
    0.5
    """
    right, left = earlier[..., :-2], earlier[..., 2:]  # copies shifted to the right and to the left
    slope = right - left
    change = (later - earlier)[..., 1:-1]
    power = slope.square().mean((-3, -2, -1))
    product = (change * slope).mean((-3, -2, -1))
    floor = max(min_contrast**2, torch.finfo(power.dtype).tiny)
    shift = 2.0 * product / power.clamp(min=floor)
    return torch.where(power >= floor, shift, torch.zeros_like(shift))


class ChahlSrinivasan(nn.Module):
    """Speed of a row in pixels per time step, sign and all: `row_shift` from each frame to the next.

    Independent of contrast, unlike the non-directional sensors, and therefore guarded where there is none.

    Shapes:
        x: floating point rows `[..., T, 1, 1, W]` or images `[..., T, C, H, W]`, W >= 3 -> `[..., T, 1]`.
        State: the last frame. With `state=None` the first output is 0.

    Args:
        min_contrast: see `row_shift`.

    Raises:
        InputError: x of another shape or type, or a negative `min_contrast`.
    """

    def __init__(self, min_contrast: float = 1e-3) -> None:
        super().__init__()
        check_number("min_contrast", min_contrast, least=0)
        self.min_contrast = min_contrast

    @trial_by_trial(1)
    def forward(self, x: Tensor, state: ShiftState | None = None) -> tuple[Tensor, ShiftState]:
        check_series(x, 3, state, ShiftState)
        if x.shape[-1] < 3:
            raise InputError(f"x must be at least 3 pixels wide, got shape {tuple(x.shape)}")
        first = x.select(-4, 0) if state is None else state.last
        frames, steps = torch.cat([first.unsqueeze(-4), x], -4), x.shape[-4]
        shift = row_shift(frames.narrow(-4, 0, steps), frames.narrow(-4, 1, steps), self.min_contrast)
        return shift.unsqueeze(-1), ShiftState(x.select(-4, -1))
