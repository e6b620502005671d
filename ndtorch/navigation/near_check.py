"""What is right before a car that stands: both horizon rows compared, nearer than the ranging looks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.navigation.rig import Rect, StereoRig
from ndtorch.navigation.strips import grey_pair, row_rect

Floats = npt.NDArray[np.float32]


@dataclass(frozen=True)
class NearParams:
    """How a car that stands looks at what is right before it.

    Args:
        nearest, farthest: depths from the cameras that count as near, m.
        beside: how far to either side of the car's middle, m.
        half: pairs of pixels compared to either side of a place.
        ratio: a match must differ by less than this share of the best one elsewhere.
        texture: least mean step of brightness from pixel to pixel around a place.
        enough: places that must agree on something near.
        floor: correlation from which what both see right ahead is one floor.
        floor_from, floor_to: depths of the floor right ahead that must be seen, m.
        floor_beside: how far to either side of the car's middle, m.
        tilt: rows by which the horizon may lie higher or lower than the rig says.
        narrowest, pixels: fewer columns of a row, or pixels in all, that both see are not compared.
        blank: standard deviation of the brightness below which nothing is seen.

    Raises:
        InputError: numbers out of range.
    """

    nearest: float = 0.25
    farthest: float = 0.95
    beside: float = 0.3
    half: int = 8
    ratio: float = 0.6
    texture: float = 0.003
    enough: int = 5
    floor: float = 0.7
    floor_from: float = 0.8
    floor_to: float = 1.15
    floor_beside: float = 0.15
    tilt: int = 26
    narrowest: int = 5
    pixels: int = 150
    blank: float = 0.002

    def __post_init__(self) -> None:
        if not (0 < self.nearest < self.farthest < math.inf and self.beside > 0):
            raise InputError(f"expected 0 < nearest < farthest and beside > 0, got {self}")
        if not self.floor_beside > 0:
            raise InputError(f"expected floor_beside > 0, got {self.floor_beside}")
        if not (self.half >= 1 and 0 < self.ratio <= 1 and self.texture >= 0 and self.enough >= 1 and self.blank >= 0):
            raise InputError(f"expected half and enough >= 1 and 0 < ratio <= 1, got {self}")


class Near(NamedTuple):
    """What a near check has found, body frame, m: places where something is; none where nothing was seen there."""

    x: Floats
    y: Floats


NEIGHBORS = 4
"""Disparities this near to the best one do not count as elsewhere."""


def near_things(left: Floats, right: Floats, rig: StereoRig, params: NearParams) -> Near:
    """Things in the path and near, from two rows `[W]` in 0..1.

    Every place of the left row with some texture is looked for in the whole right row (sum of absolute differences);
    a match counts that is unlike all others and is found from the right as well.
    """
    p, focal = params, rig.focal / 2
    left, right = pairs_of(left), pairs_of(right)
    width, size = len(left), 2 * params.half + 1
    low = max(2, math.floor(focal * rig.baseline / p.farthest))
    high = min(width - size - 1, math.ceil(focal * rig.baseline / p.nearest))
    first = max(1, low // 8)  # what is farther must be able to match where it is
    none = np.zeros(0, np.float32)
    if high <= low:
        return Near(none, none)
    cost = np.full((high - first, width), 9.0, np.float32)
    for d in range(first, high):
        sums = np.cumsum(np.abs(left[d:] - right[: width - d]), dtype=np.float64)
        windows = np.concatenate((sums[size - 1 : size], sums[size:] - sums[:-size])) / size
        cost[d - first, d + p.half : d + p.half + len(windows)] = windows
    columns = np.arange(width)
    best = cost.argmin(0)
    value = cost[best, columns]
    disparity = best + first
    # From the right: the best left partner of the column that was found.
    partner = np.clip(columns - disparity, 0, width - 1)
    places = np.arange(first, high)[:, None] + partner[None]
    from_right = np.where(places < width, cost[np.arange(high - first)[:, None], np.minimum(places, width - 1)], 9.0)
    mutual = np.abs(from_right.argmin(0) - best) <= 2
    apart = np.abs(np.arange(high - first)[:, None] - best[None]) > NEIGHBORS
    elsewhere = np.where(apart, cost, 9.0).min(0)
    steps = np.abs(np.diff(left, prepend=left[:1]))
    busy = np.convolve(steps, np.ones(size) / size, "same") >= p.texture
    depth = focal * rig.baseline / disparity
    aside = rig.baseline / 2 + depth * ((width - 1) / 2 - columns) / focal
    good = mutual & busy & (value < p.ratio * elsewhere) & (disparity >= low) & (np.abs(aside) <= p.beside)
    # Neighbors that agree: a mismatch seldom has any.
    depths = np.where(good, depth, np.nan)
    found = [k for k in np.flatnonzero(good).tolist() if agreeing(depths, k, p)]
    x, y = rig.forward + depth[found], aside[found]
    return Near(np.asarray(x, np.float32), np.asarray(y, np.float32))


def pairs_of(row: Floats) -> Floats:
    """Means of two pixels each: a quarter of the work, and what is near is coarse."""
    row = row[: len(row) // 2 * 2]
    return np.asarray((row[::2] + row[1::2]) / 2, np.float32)


def agreeing(depths: npt.NDArray[np.float64], k: int, params: NearParams) -> bool:
    """Whether enough places around column `k` have its depth, within a tenth."""
    around = depths[max(0, k - params.half) : k + params.half + 1]
    return int((np.abs(around - depths[k]) < 0.1 * depths[k]).sum()) >= params.enough


def floor_likeness(left: Floats, right: Floats, rects: tuple[Rect, Rect], rig: StereoRig, params: NearParams) -> float:
    """How much what both cameras see right ahead looks like one floor: a correlation, 0 where nothing is seen.

    A place of the floor is seen `baseline / height` pixels farther apart for every row below the horizon; a wall is
    seen equally far apart in all rows. Rows are compared less their means, since the foot of a wall lies in one row of
    both images. Cameras that look up or down a little are allowed for.

    Args:
        left, right: the subfields `[h, w]` in 0..1.
        rects: where they are.
    """
    p, ours = params, rects[0]
    horizon = (rig.height - 1) / 2 - rig.focal * math.tan(rig.pitch)
    rows = np.arange(ours.top, ours.bottom)
    depth = rig.focal * rig.camera_height / np.maximum(rows - horizon, 1.0)
    rows = rows[(depth >= p.floor_from) & (depth <= p.floor_to)][::2]
    best = row_likeness(left, right, rows, 0, horizon, rects, rig, p)
    for offset in range(-p.tilt, p.tilt + 1, 2):
        if best >= p.floor:
            break
        best = max(best, row_likeness(left, right, rows, offset, horizon, rects, rig, p))
    return best


def row_likeness(
    left: Floats,
    right: Floats,
    rows: npt.NDArray[np.int64],
    offset: int,
    horizon: float,
    rects: tuple[Rect, Rect],
    rig: StereoRig,
    params: NearParams,
) -> float:
    """The correlation over these rows for a horizon that lies `offset` rows higher."""
    ours, theirs = rects
    shift = np.round(rig.baseline / rig.camera_height * (rows - horizon + offset)).astype(np.int64)[:, None]
    # Columns of the left image whose partner lies in the right subfield.
    first = max(ours.left, theirs.left + int(shift.min(initial=ours.right)))
    columns = np.arange(first, ours.right)
    partner = columns - shift - theirs.left
    both = (partner >= 0) & (partner < theirs.right - theirs.left)
    # Where the middle between both cameras sees what lies right ahead; `shift` is focal * baseline / depth.
    middle = (rig.width - 1) / 2 - columns + shift / 2
    both &= np.abs(middle) * rig.baseline <= params.floor_beside * shift
    both &= both.sum(1, keepdims=True) >= params.narrowest
    count = both.sum(1, keepdims=True)
    if count.sum() < max(1, params.pixels):
        return 0.0

    def less_mean(pixels: Floats) -> Floats:
        """Of every row, 0 where there is no partner."""
        kept = np.where(both, pixels, np.float32(0))
        mean = kept.sum(1, keepdims=True) / np.maximum(count, 1)
        return np.where(both, kept - mean.astype(np.float32), np.float32(0))

    a = less_mean(left[rows - ours.top, first - ours.left :])
    b = less_mean(right[(rows - theirs.top)[:, None], partner.clip(0, theirs.right - theirs.left - 1)])
    squares = float(np.vdot(a, a)), float(np.vdot(b, b))
    if min(squares) < float(count.sum()) * params.blank**2:
        return 0.0
    return float(np.vdot(a, b)) / math.sqrt(squares[0] * squares[1])


class NearCheck:
    """Looks at what is right before a car that stands.

    Args:
        rig: the camera pair.
        rects: the subfields of both images.
        params: its numbers.
    """

    def __init__(self, rig: StereoRig, rects: tuple[Rect, Rect], params: NearParams | None = None) -> None:
        self.rig, self.rects, self.params = rig, rects, params or NearParams()
        self.row = row_rect(rig)
        y = np.linspace(-self.params.beside, self.params.beside, 9, dtype=np.float32)
        self.across = Near(np.full_like(y, rig.forward + self.params.nearest), y)

    def __call__(self, fields: tuple[Tensor, Tensor], rows: tuple[Tensor, Tensor]) -> tuple[Near, bool]:
        """Things that are near, and whether floor is seen right ahead.

        Args:
            fields, rows: of the left and the right camera, frames `[C, H, W]`, whole or cut.
        """
        size = (self.rig.height, self.rig.width)
        grey = grey_pair(rows[0][None], rows[1][None], self.row, self.row, size)[0, :, 0].float().numpy()
        floor = grey_pair(fields[0][None], fields[1][None], *self.rects, size)[0].float().numpy()
        seen = floor_likeness(floor[0], floor[1], self.rects, self.rig, self.params) >= self.params.floor
        return near_things(grey[0], grey[1], self.rig, self.params), seen
