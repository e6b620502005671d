"""From the horizon rows of two cameras to the ranges of what they see."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_dense, check_state
from ndtorch.errors import InputError
from ndtorch.navigation.correspondence import MatchParams, match_features
from ndtorch.navigation.features import FeatureParams, Features, find_features
from ndtorch.navigation.prediction import PredictedFeatures, PredictionState
from ndtorch.navigation.ranging import Ranges, triangulate
from ndtorch.navigation.rig import AngleModel, StereoRig
from ndtorch.navigation.row_search import SearchParams, search_rows
from ndtorch.navigation.strip_kernels import eyes, ranges_of_rows, searched_ranges, state_fits
from ndtorch.navigation.strips import check_eyes, check_unit_range, grey_pair, row_rect
from ndtorch.vision.nondirectional import NDMin, spatial_maximum
from ndtorch.vision.temporal import FilterState

AHEAD = math.radians(15.0)
"""Bearings within which something lies ahead: the way of the body from 0.6 m on, for the rig of [A]."""


class RowRangingState(NamedTuple):
    """State of `RowRanging`: the filters of the rows `[..., 2, 1, W]`, and the features that are followed, if any."""

    rows: FilterState
    followed: PredictionState | None


class RowRanging(nn.Module):
    """Ranges of features of the horizon rows: ND-min, features, correspondence, triangulation. [A fig. 10]

    Shapes:
        left, right: frames `[..., T, C, H, W]`, or rows `[..., T, C, 1, W]`, uint8 or float in 0..1,
            C = 1 or 3 -> `Ranges` of `[..., T, n]`.
        State: `RowRangingState`; `None` settles on the first frame, which then has no features.

    Args:
        rig: the camera pair.
        dt: time step, s.
        features, matching: parameters of the steps.
        angles: `"atan"` (exact) or `"linear"` (as published).
        tau_high: time constant of the high-pass, s.
        search: search the right row instead of matching features, see `row_search`. Of whole frames it reads
            `search.rows` rows; strips may hold so many, or only the horizon row.

    Attributes:
        row: the rectangle that is read of both frames.

    Raises:
        InputError: frames that cannot be used, or NaN, infinity or values far beyond 1 in their rows; a horizon too
            near the border for the rows that are searched.

    >>> from ndtorch.navigation import StereoRig
    >>> rows = torch.rand(2, 4, 1, 1, 640)
    >>> ranges, state = RowRanging(StereoRig(), dt=1 / 30)(*rows)
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
        self.follow = PredictedFeatures(self.features, self.features.follow) if self.features.follow else None
        exact = angles == "atan"
        factor = math.cos(rig.pitch) / rig.focal if exact else rig.pixel_angle
        self.geometry = (rig.center[0], factor, rig.baseline, rig.forward, exact)
        # Nearer the border, a partner with the smallest disparity would lie outside the other row.
        self.border = math.ceil(self.matching.min_disparity) if self.features.shared else 0
        f, m = self.features, self.matching
        # As the kernels take them.
        self.finding = (
            f.count,
            f.spacing,
            f.min_motion,
            f.min_difference,
            f.edge_reach,
            self.border,
            (f.ahead, *self.band),
        )
        self.limits = (float(m.min_disparity), float(m.max_disparity), m.one_to_one, float(m.max_error))

    def forward(
        self, left: Tensor, right: Tensor, state: RowRangingState | None = None
    ) -> tuple[Ranges, RowRangingState]:
        check_state(state, RowRangingState)
        check_eyes(left, right)
        quick = self.by_kernels(left, right, state)
        if quick is not None:
            return quick
        one = left.ndim > 1 and left.shape[-2] == 1
        rect = self.horizon if one else self.row
        around = grey_pair(left, right, rect, rect, (self.rig.height, self.rig.width))
        if self.search is not None:
            if left.is_floating_point():
                check_unit_range(around.abs(), left)
            ranges = triangulate(search_rows(around, self.search, self.band), self.rig, self.angles)
            # It needs no motion; the state keeps the last rows, as filters do that have settled on them.
            horizon = around[..., -1, :, around.shape[-2] // 2, :].unsqueeze(-2)
            return ranges, RowRangingState(FilterState(horizon), None)
        rows = around
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
        return ranges, RowRangingState(filters, followed)

    def by_kernels(
        self, left: Tensor, right: Tensor, state: RowRangingState | None
    ) -> tuple[Ranges, RowRangingState] | None:
        """One frame by kernels; None where torch is to do it."""
        if self.search is not None:
            return self.searched(left, right, self.search)
        before, width = state.rows if state else None, self.rig.width
        if self.follow is not None or not state_fits(before, left, (2, 1, width)):
            return None
        seen = eyes(left, right, (self.row, self.row), (self.rig.height, width))
        if seen is None:
            return None
        out, valid, largest, rows = ranges_of_rows(
            seen, before, left, width, self.nd_min.a, self.finding, self.limits, self.geometry
        )
        if left.is_floating_point():
            check_unit_range(torch.tensor(largest), left)
        distance, left_angle, right_angle, x, y = out.unbind(0)
        return Ranges(distance, left_angle, right_angle, x, y, valid), RowRangingState(rows, None)

    def searched(self, left: Tensor, right: Tensor, search: SearchParams) -> tuple[Ranges, RowRangingState] | None:
        """The same where the right row is searched."""
        rect = self.horizon if left.ndim > 1 and left.shape[-2] == 1 else self.row
        seen = eyes(left, right, (rect, rect), (self.rig.height, self.rig.width))
        if seen is None:
            return None
        around = rect.bottom - rect.top
        out, valid, largest, rows = searched_ranges(
            seen, left, self.rig.width, around, search.count, search.numbers, self.band, self.geometry
        )
        if left.is_floating_point():
            check_unit_range(torch.tensor(largest), left)
        distance, left_angle, right_angle, x, y = out.unbind(0)
        return Ranges(distance, left_angle, right_angle, x, y, valid), RowRangingState(rows, None)

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
