"""Ranges from the horizon rows of both cameras: features, correspondence, triangulation; or a search of a row."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from ndtorch.arguments import check_state
from ndtorch.errors import InputError
from ndtorch.navigation.stereo._kernels import Frames, feature_ranges, grey_fields, packed
from ndtorch.navigation.stereo._kernels import triangulate as triangulate_places
from ndtorch.navigation.stereo.features import (
    FeatureParams,
    Features,
    Matches,
    MatchParams,
    PredictedFeatures,
    PredictionState,
    find_features,
    match_features,
)
from ndtorch.navigation.stereo.rig import AngleModel, StereoRig
from ndtorch.navigation.stereo.search import SearchParams, find_places, search_rows
from ndtorch.navigation.stereo.strips import at_rects, check_peak, checked, grey_pair, row_rect
from ndtorch.vision.nondirectional import NDMin, spatial_maximum
from ndtorch.vision.temporal import FilterState


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


class StereoRangingState(NamedTuple):
    """State of `StereoRanging`.

    Attributes:
        rows: the filters of the rows, `[..., 2, 1, W]`; an array `[2, W]` in compiled steps.
        followed: the features that are followed, if any.
    """

    rows: Any
    followed: PredictionState | None


class StereoRanging(nn.Module):
    """Ranges of features of the horizon rows: ND-min, features, correspondence, triangulation. [A fig. 10]

    Shapes:
        left, right: frames `[..., T, C, H, W]`, or rows `[..., T, C, 1, W]`, uint8 or float in 0..1,
            C = 1 or 3 -> `Ranges` of `[..., T, n]`.
        State: `StereoRangingState`; `None` settles on the first frame, which then has no features.

    Args:
        rig: the camera pair.
        dt: time step, s.
        features, matching: parameters of the steps.
        angles: `"atan"` (exact) or `"linear"` (as published).
        tau_high: time constant of the high-pass, s.
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
        tau_high: float = 0.005,
        search: SearchParams | None = None,
    ) -> None:
        super().__init__()
        if angles not in ("atan", "linear"):
            raise InputError(f"angles must be 'atan' or 'linear', got {angles!r}")
        self.rig, self.angles, self.size = rig, angles, (rig.height, rig.width)
        self.features, self.matching = f, m = features or FeatureParams(), matching or MatchParams()
        self.search = search
        self.row, self.horizon = row_rect(rig, 1 if search is None else search.rows), row_rect(rig)
        self.nd_min = NDMin(tau_high, dt)
        self.follow = PredictedFeatures(f, f.follow_reach_px) if f.follow_reach_px else None
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

    def forward(
        self, left: Tensor, right: Tensor, state: StereoRangingState | None = None
    ) -> tuple[Ranges, StereoRangingState]:
        check_state(state, StereoRangingState)
        rect = self.horizon if getattr(left, "ndim", 0) > 1 and left.shape[-2] == 1 else self.row
        rows = grey_pair(left, right, rect, rect, self.size)
        if self.search is not None:
            check_peak(rows.abs(), left)
            # It needs no motion; the state keeps the last rows, as filters do that have settled on them.
            horizon = rows[..., -1, :, rows.shape[-2] // 2, :].unsqueeze(-2)
            ranges = triangulate(search_rows(rows, self.search), self.rig, self.angles)
            return ranges, StereoRangingState(FilterState(horizon), None)
        motion, filters = self.nd_min.scan(rows, state.rows if state else None, rows.ndim - 4)
        check_peak(spatial_maximum(motion), left)
        rows, motion, followed = rows.squeeze(-2), motion.squeeze(-2), state.followed if state else None
        if self.border:
            # What lies left in the left row, or right in the right one, has no partner.
            inside = torch.arange(self.size[1], device=motion.device) >= self.border
            motion = motion * torch.stack((inside, inside.flip(0)))
        if self.follow is None:
            found = find_features(rows, motion, self.features)
        else:
            found, followed = self.follow(rows.transpose(-2, -3), motion.transpose(-2, -3), followed)
            column, strength, patch, valid = found
            patch = patch.transpose(-3, -4)
            found = Features(column.transpose(-2, -3), strength.transpose(-2, -3), patch, valid.transpose(-2, -3))
        eyes = (found.column.unbind(-2), found.strength.unbind(-2), found.patch.unbind(-3), found.valid.unbind(-2))
        one, other = (Features(*eye) for eye in zip(*eyes, strict=True))
        ranges = triangulate(match_features(one, other, self.matching), self.rig, self.angles)
        return ranges, StereoRangingState(filters, followed)

    def step(self, frames: Frames, state: StereoRangingState | None) -> tuple[Ranges, StereoRangingState]:
        """One frame of each camera, compiled: ranges as arrays `[n]`.

        Args:
            frames: whole frames, or rows.
            state: of the step before; None begins with this frame.
        """
        if self.follow is not None:  # torch follows features from frame to frame
            order = (2, 0, 1) if frames.interleaved else (0, 1, 2)
            eyes = (torch.from_numpy(eye).permute(order).unsqueeze(0) for eye in frames[:2])
            ranges, after = self(*eyes, state)
            return Ranges(*(part[0].numpy() for part in ranges)), after
        rect = self.horizon if frames.left.shape[0 if frames.interleaved else 1] == 1 else self.row
        rows, low = at_rects(frames, (rect, rect), self.size), np.empty((2, self.size[1]), np.float32)
        if self.search is not None:
            pair = np.empty((2, rect.bottom - rect.top, low.shape[1]), np.float32)
            found = np.empty((3, self.search.count), np.float32)
            peak = np.nan if not grey_fields(rows, 1, pair) else max(pair.max(), -pair.min())
            check_peak(peak)  # the search indexes by what it reads
            low[:] = pair[:, pair.shape[1] // 2]
            find_places(pair, self.searched, found)
            out, valid = np.stack((found[1],) * 5), found[0] > 0
            triangulate_places(found[0], self.numbers, out, valid)
        else:
            out, valid = np.empty((5, self.features.count), np.float32), np.empty(self.features.count, np.bool_)
            before = low if state is None else checked(state.rows, low.shape)
            peak = feature_ranges(rows, state is None, before, low, self.numbers, out, valid)
        check_peak(peak)
        distance, one, other, x, y = out
        return Ranges(distance, one, other, x, y, valid), StereoRangingState(low, None)
