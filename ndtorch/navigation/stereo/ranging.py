"""Ranges from the horizon rows of both cameras: features, correspondence, triangulation; or a search of a row."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from ndtorch.arguments import check_state
from ndtorch.errors import InputError
from ndtorch.navigation.stereo._kernels import Array, Frames, feature_ranges, packed
from ndtorch.navigation.stereo.features import (
    FeatureParams,
    Features,
    Matches,
    MatchParams,
    find_features,
    match_features,
)
from ndtorch.navigation.stereo.rig import AngleModel, StereoRig
from ndtorch.navigation.stereo.search import SearchParams, search_ranges, search_rows
from ndtorch.navigation.stereo.strips import at_rects, check_peak, checked, grey_pair, row_rect
from ndtorch.vision.nondirectional import NDMin, spatial_maximum
from ndtorch.vision.temporal import FilterState

TAU_HIGH = 0.005  # time constant of the high-pass, s, as [A] has it


class Ranges(NamedTuple):
    """Ranged features, tensors or arrays `[..., n]`; slots that are not `valid` hold zeros.

    Attributes:
        left_range: distance from the left camera, m, [A eq. A.5].
        left_angle, right_angle: angles at the two cameras, radians, to the left positive.
        x, y: place in the body frame, m.
        valid: bool.
    """

    left_range: Any
    left_angle: Any
    right_angle: Any
    x: Any
    y: Any
    valid: Any


def triangulate(matches: Matches, rig: StereoRig, angles: AngleModel = "atan") -> Ranges:
    """`R_L = b cos(theta_R) / sin(theta_R - theta_L)` for every valid match. [A eq. A.3-A.5]

    Since a valid match has a positive disparity, its rays meet in front of the cameras: every range is
    positive and finite. With disparities 60 to 200 and b = 0.3 m, f = 430 the window straight ahead is
    0.65-2.15 m (2.37 m with the linear angles).
    """
    dtype = matches.error.dtype
    position = rig.pixel_position(torch.stack((matches.left, matches.right)).to(dtype))
    left, right = rig.angle(position, angles)
    valid = matches.valid & (right > left)
    # Slots without a match get angles that meet, so that neither values nor gradients there can be infinite.
    converging = (right - left).masked_fill(~valid, 1.0)
    distance = rig.baseline * right.cos() / converging.sin()
    x = rig.forward + distance * left.cos()
    y = rig.baseline / 2 + distance * left.sin()
    distance, left, right, x, y = torch.stack((distance, left, right, x, y)) * valid
    return Ranges(distance, left, right, x, y, valid)


class StereoRanging(nn.Module):
    """Ranges of features of the horizon rows: ND-min, features, correspondence, triangulation. [A fig. 10]

    Shapes:
        left, right: frames `[..., T, C, H, W]`, or rows `[..., T, C, 1, W]`, uint8 or float in 0..1,
            C = 1 or 3 -> `Ranges` of `[..., T, n]`.
        State: the filters of the rows, `FilterState` of `[..., 2, 1, W]`, an array `[2, W]` in compiled steps; `None`
            settles on the first frame, which then has no features.

    Args:
        rig: the camera pair.
        dt: time step, s.
        features, matching: parameters of the steps.
        angles: `"atan"` (exact) or `"linear"` (as published).
        search: search the right row instead of matching features, see `search`. Of whole frames it reads
            `search.rows` rows; strips may hold so many, or only the horizon row.

    Attributes:
        row: the rectangle that is read of both frames.

    Raises:
        InputError: frames that cannot be used, or NaN, infinity or values far beyond 1 in their rows; a horizon too
            near the border for the rows that are searched.

    >>> from ndtorch.navigation import StereoRig
    >>> rows = torch.rand(2, 4, 1, 1, 640)
    >>> ranges, state = StereoRanging(StereoRig(), dt=1 / 30)(*rows)
    >>> ranges.left_range.shape
    torch.Size([4, 5])
    """

    def __init__(
        self,
        rig: StereoRig,
        dt: float,
        features: FeatureParams | None = None,
        matching: MatchParams | None = None,
        angles: AngleModel = "atan",
        search: SearchParams | None = None,
    ) -> None:
        super().__init__()
        if angles not in ("atan", "linear"):
            raise InputError(f"angles must be 'atan' or 'linear', got {angles!r}")
        self.rig, self.angles, self.size = rig, angles, (rig.height, rig.width)
        self.features, self.matching = f, m = features or FeatureParams(), matching or MatchParams()
        self.search = search
        self.row, self.horizon = row_rect(rig, 1 if search is None else search.rows), row_rect(rig)
        self.nd_min = NDMin(TAU_HIGH, dt)
        # Nearer the border, a partner with the smallest disparity would lie outside the other row.
        self.border = math.ceil(m.min_disparity_px) if f.shared else 0
        self.numbers = packed(
            f,
            m,
            border=self.border,
            a=float(self.nd_min.a),
            axis=float(rig.center[0]),
            factor=math.cos(rig.pitch) / rig.focal if angles == "atan" else rig.pixel_angle,
            exact=angles == "atan",
            baseline=float(rig.baseline),
            forward=float(rig.forward),
        )
        self.searched = None if search is None else packed(search)

    def forward(self, left: Tensor, right: Tensor, state: FilterState | None = None) -> tuple[Ranges, FilterState]:
        check_state(state, FilterState)
        rect = self.horizon if getattr(left, "ndim", 0) > 1 and left.shape[-2] == 1 else self.row
        rows = grey_pair(left, right, rect, rect, self.size)
        if self.search is not None:
            check_peak(rows.abs(), left)
            # It needs no motion; the state keeps the last rows, as filters do that have settled on them.
            horizon = rows[..., -1, :, rows.shape[-2] // 2, :].unsqueeze(-2)
            return triangulate(search_rows(rows, self.search), self.rig, self.angles), FilterState(horizon)
        motion, state = self.nd_min.scan(rows, state)
        check_peak(spatial_maximum(motion), left)
        rows, motion = rows.squeeze(-2), motion.squeeze(-2)
        if self.border:
            # What lies left in the left row, or right in the right one, has no partner.
            inside = torch.arange(self.size[1], device=motion.device) >= self.border
            motion = motion * torch.stack((inside, inside.flip(0)))
        eyes = (part.unbind(rows.ndim - 2) for part in find_features(rows, motion, self.features))
        one, other = (Features(*parts) for parts in zip(*eyes, strict=True))
        return triangulate(match_features(one, other, self.matching), self.rig, self.angles), state

    def step(self, frames: Frames, state: Array | None) -> tuple[Ranges, Array]:
        """One frame of each camera, compiled: ranges as arrays `[n]`.

        Args:
            frames: whole frames, or rows.
            state: of the step before; None begins with this frame.
        """
        rect = self.horizon if frames.left.shape[0 if frames.interleaved else 1] == 1 else self.row
        frames, low = at_rects(frames, (rect, rect), self.size), np.empty((2, self.size[1]), np.float32)
        count = self.features.count if self.search is None else self.search.count
        out, valid = np.empty((5, count), np.float32), np.empty(count, np.bool_)
        if self.search is None:
            before = low if state is None else checked(state, low.shape)
            peak = feature_ranges(frames, state is None, before, low, self.numbers, out, valid)
        else:
            peak = search_ranges(frames, rect.bottom - rect.top, self.searched, self.numbers, low, out, valid)
        check_peak(peak)
        distance, one, other, x, y = out
        return Ranges(distance, one, other, x, y, valid), low
