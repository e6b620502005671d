"""Ranges from the horizon rows of both cameras: features, correspondence, triangulation; or a search of a row."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from ndtorch.arguments import check_dense, check_state
from ndtorch.errors import InputError
from ndtorch.navigation.stereo._kernels import Frames
from ndtorch.navigation.stereo._kernels_features import FeatureNumbers, RowGeometry, feature_ranges
from ndtorch.navigation.stereo._kernels_features import triangulate as triangulate_places
from ndtorch.navigation.stereo._kernels_search import find_places, grey_rows
from ndtorch.navigation.stereo.correspondence import Matches, MatchParams, match_features
from ndtorch.navigation.stereo.features import FeatureParams, Features, find_features
from ndtorch.navigation.stereo.prediction import PredictedFeatures, PredictionState
from ndtorch.navigation.stereo.rig import AngleModel, StereoRig
from ndtorch.navigation.stereo.search import SearchParams, search_rows
from ndtorch.navigation.stereo.strips import (
    at_rects,
    check_eyes,
    check_peak,
    check_unit_range,
    checked,
    grey_pair,
    row_rect,
)
from ndtorch.utils.jit import packed
from ndtorch.vision.nondirectional import NDMin, spatial_maximum
from ndtorch.vision.temporal import FilterState

AHEAD = math.radians(15.0)
"""Bearings within which something lies ahead: the path of the body from 0.6 m on, for the rig of [A]."""


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
        self.rig, self.angles = rig, angles
        self.features, self.matching = features or FeatureParams(), matching or MatchParams()
        self.search = search
        self.row, self.horizon = row_rect(rig, 1 if search is None else search.rows), row_rect(rig)
        self.band = rig.columns(AHEAD)
        self.nd_min = NDMin(tau_high, dt)
        self.follow = (
            PredictedFeatures(self.features, self.features.follow_reach_px) if self.features.follow_reach_px else None
        )
        exact = angles == "atan"
        factor = math.cos(rig.pitch) / rig.focal if exact else rig.pixel_angle
        self.geometry = packed(
            RowGeometry(float(rig.center[0]), factor, float(rig.baseline), float(rig.forward), exact)
        )
        f, m = self.features, self.matching
        # Nearer the border, a partner with the smallest disparity would lie outside the other row.
        self.border = math.ceil(m.min_disparity_px) if f.shared else 0
        limits = (float(m.min_disparity_px), float(m.max_disparity_px), m.one_to_one, float(m.max_error))
        places = (f.edge_reach_px, self.border, f.ahead_count, *self.band)
        least = (float(f.min_motion), float(f.min_difference))
        self.numbers = packed(
            FeatureNumbers(f.count, f.spacing_px, least[0], least[1], *places, *limits, self.nd_min.a)
        )
        self.searched = None if search is None else search.numbers(self.band)

    def forward(
        self, left: Tensor, right: Tensor, state: StereoRangingState | None = None
    ) -> tuple[Ranges, StereoRangingState]:
        check_state(state, StereoRangingState)
        check_eyes(left, right)
        one = left.ndim > 1 and left.shape[-2] == 1
        rect = self.horizon if one else self.row
        rows = grey_pair(left, right, rect, rect, (self.rig.height, self.rig.width))
        if self.search is not None:
            if left.is_floating_point():
                check_unit_range(rows.abs(), left)
            ranges = triangulate(search_rows(rows, self.search, self.band), self.rig, self.angles)
            # It needs no motion; the state keeps the last rows, as filters do that have settled on them.
            horizon = rows[..., -1, :, rows.shape[-2] // 2, :].unsqueeze(-2)
            return ranges, StereoRangingState(FilterState(horizon), None)
        if state is not None:
            check_dense("state.rows.low", state.rows.low)
        motion, filters = self.nd_min.scan(rows, state.rows if state else None, rows.ndim - 4)
        if left.is_floating_point():
            check_unit_range(spatial_maximum(motion), left)
        if self.border:
            motion = self.without_borders(motion)
        found, followed = self.find(rows.squeeze(-2), motion.squeeze(-2), state.followed if state else None)
        eyes = zip(
            found.column.unbind(-2),
            found.strength.unbind(-2),
            found.patch.unbind(-3),
            found.valid.unbind(-2),
            strict=True,
        )
        ours, theirs = (Features(*eye) for eye in eyes)
        ranges = triangulate(match_features(ours, theirs, self.matching), self.rig, self.angles)
        return ranges, StereoRangingState(filters, followed)

    def step(self, frames: Frames, state: StereoRangingState | None) -> tuple[Ranges, StereoRangingState]:
        """One frame of each camera, compiled: ranges as arrays `[n]`.

        Args:
            frames: whole frames, or rows.
            state: of the step before; None begins with this frame.
        """
        height, width = frames.left.shape[0 if frames.interleaved else 1], self.rig.width
        if self.follow is not None:
            return self.followed(frames, state)
        rect = self.horizon if height == 1 else self.row
        rows, low = at_rects(frames, (rect, rect), (self.rig.height, width)), np.empty((2, width), np.float32)
        if self.searched is not None:
            count = self.searched.places
            found, out = np.empty((3, count), np.float32), np.empty((5, count), np.float32)
            pair = np.empty((2, rect.bottom - rect.top, width), np.float32)
            peak = grey_rows(rows, pair, low)
            find_places(*pair, self.searched, found)
            out[0], valid = found[1], found[0] > 0
            triangulate_places(found[0], self.geometry, out, valid)
        else:
            out, valid = np.empty((5, self.features.count), np.float32), np.empty(self.features.count, np.bool_)
            before = low if state is None else checked(state.rows, low.shape)
            peak = feature_ranges(rows, state is None, before, low, self.numbers, self.geometry, out, valid)
        check_peak(peak)
        distance, left, right, x, y = out
        return Ranges(distance, left, right, x, y, valid), StereoRangingState(low, None)

    def followed(self, frames: Frames, state: StereoRangingState | None) -> tuple[Ranges, StereoRangingState]:
        """`step` where features are followed from frame to frame, which torch does."""
        eyes = (torch.from_numpy(eye) for eye in (frames.left, frames.right))
        planes = ((eye.permute(2, 0, 1) if frames.interleaved else eye).unsqueeze(0) for eye in eyes)
        ranges, after = self(*planes, state)
        return Ranges(*(part[0].numpy() for part in ranges)), after

    def without_borders(self, motion: Tensor) -> Tensor:
        """Motion `[..., 2, 1, W]` less the columns that have no partner: left of the left row, right of the right."""
        motion = motion.clone()
        motion[..., 0, :, : self.border] = 0
        motion[..., 1, :, motion.shape[-1] - self.border :] = 0
        return motion

    def find(
        self, rows: Tensor, motion: Tensor, state: PredictionState | None
    ) -> tuple[Features, PredictionState | None]:
        """Features of rows `[..., T, 2, W]`: those of each frame, or the same ones as long as they can be followed."""
        if self.follow is None:
            return find_features(rows, motion, self.features, self.band), None
        found, state = self.follow(rows.transpose(-2, -3), motion.transpose(-2, -3), state)
        column, strength, valid = (x.transpose(-2, -3) for x in (found.column, found.strength, found.valid))
        return Features(column, strength, found.patch.transpose(-3, -4), valid), state
