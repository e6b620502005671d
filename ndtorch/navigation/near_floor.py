"""Whether what both cameras see right ahead is one floor."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ndtorch.kernels.near_floor import near_floor
from ndtorch.navigation.near_params import NearParams
from ndtorch.navigation.rig import Rect, StereoRig

Floats = npt.NDArray[np.float32]


def floor_likeness(
    left: Floats, right: Floats, rects: tuple[Rect, Rect], rig: StereoRig, params: NearParams, by_kernel: bool = False
) -> float:
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
    offsets = [0, *range(-p.tilt, p.tilt + 1, 2)]
    if by_kernel:
        return floor_by_kernel(left, right, rows, offsets, horizon, rects, rig, p)
    best = -1.0
    for offset in offsets:
        best = max(best, row_likeness(left, right, rows, offset, horizon, rects, rig, p))
        if best >= p.floor:
            break
    return best


def floor_by_kernel(
    left: Floats,
    right: Floats,
    rows: npt.NDArray[np.int64],
    offsets: list[int],
    horizon: float,
    rects: tuple[Rect, Rect],
    rig: StereoRig,
    params: NearParams,
) -> float:
    """The largest `row_likeness` over these horizons, the first of them that is enough."""
    ours, theirs = rects
    places = (ours.top, ours.left, theirs.top, theirs.left)
    beside = params.floor_beside / rig.baseline
    numbers = (rig.baseline / rig.camera_height, horizon, (rig.width - 1) / 2, beside, params.floor, params.blank)
    kinds = np.asarray(rows, np.int64), np.array(offsets, np.int64)
    run = near_floor
    return float(run(left, right, *kinds, places, numbers, params.narrowest, params.pixels))


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
