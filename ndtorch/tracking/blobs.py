"""Blobs: connected components of the foreground mask, split where they are narrow, without ghosts and fragments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.foreground.arrays import Bools, Bytes, Floats, Labels
from ndtorch.foreground.background import BackgroundModel, BackgroundParams
from ndtorch.foreground.segmentation import Segmentation
from ndtorch.tracking._kernels_blobs import find_ghosts, label_components, mark_cast, mark_still, split_components
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.track import Track, is_small

ISOLATION_DISTANCE = 0.2
"""A small blob is isolated if larger ones are at least this far away (fraction of the height)."""
SHADOW_COLUMNS = 5
"""Columns are compared by the sum over so many."""
MIN_PART_RATIO = 0.2
"""A blob is cut only if each part has at least this share of it."""


class Blobs(NamedTuple):
    """N blobs.

    Attributes:
        labels: number of the blob of every pixel from 1, 0 where none is, `[h, w]`.
        boxes: top, left, bottom and right of each, pixels, `[N, 4]`.
        areas: pixels of each, `[N]`.
    """

    labels: Labels
    boxes: npt.NDArray[np.int64]
    areas: npt.NDArray[np.int64]


def detect_blobs(
    seen: Segmentation,
    background: BackgroundModel,
    tracks: Sequence[Track],
    labels: Labels,
    moving: Bytes,
    time: float,
    learning: BackgroundParams,
    p: TrackingParams,
) -> tuple[Blobs, Bools | None]:
    """Blobs of a foreground mask, and the ghosts that were removed from it, `[h, w]`; None without any.

    Args:
        tracks: followed so far.
        labels: number of the track of every pixel plus one, a step ago, `[h, w]`.
        moving: 1 for such numbers of objects that move: plain parts of them do not change, and are no ghosts.
        learning: constants of the background model.
    """
    mask, pixels = seen.mask, seen.mask.size
    smallest = p.min_area_ratio * pixels
    ghost, (free, still) = None, np.empty((2, *mask.shape), np.bool_)
    few = mark_still(mask, labels, moving, background.static_time, learning.static_after_s, free, still)
    # Mostly next to nothing is static, and components are dear. So few pixels enclose no more.
    if few * (few / 4 + 1) >= smallest:
        ghost = ghosts(free, still, seen.grey, seen.background, smallest)
    if ghost is not None:
        mask = mask & ~ghost
    least = min(p.min_area_isolated_ratio, p.min_area_ratio) * pixels
    found = connected_components(mask, least, p.closing_px)
    cast = cast_shadows(found, mask, seen.narrow_shadow)
    if cast is not None:
        found = connected_components(mask & ~cast, least, p.closing_px)
    return drop_fragments(split_blobs(found, p.split_notch_ratio, smallest), tracks, time, p), ghost


def connected_components(mask: Bools, smallest: float, gap: int) -> Blobs:
    """Connected components (8 neighbours) of at least `smallest` pixels.

    Gaps of up to `gap` pixels are closed, and what a component encloses is filled.
    """
    labels = np.empty(mask.shape, np.int32)
    found = np.empty((((len(mask) + 1) // 2) * ((mask.shape[1] + 1) // 2), 5), np.int64)
    number = label_components(mask, gap, float(smallest), labels, found)
    return Blobs(labels, found[:number, :4].copy(), found[:number, 4].copy())


def cast_shadows(blobs: Blobs, mask: Bools, narrow: Bytes) -> Bools | None:
    """Narrow shadows that objects cast beside them, `[h, w]`; None without any.

    They are columns of a blob most of whose pixels may be narrow shadow, beside others where most are not.

    Args:
        mask: foreground, and narrow: 1 where a narrow shadow may be, `[h, w]`.
    """
    found = np.zeros_like(mask)
    return found if mark_cast(blobs.labels, blobs.boxes, mask, narrow, SHADOW_COLUMNS, found) else None


def split_blobs(blobs: Blobs, notch: float, least: float) -> Blobs:
    """Blobs cut where they are narrow: people or cars side by side that hang together by little.

    The pixels of a blob are counted column by column, and smoothed over an eighth of its height. It is cut at the
    smallest count between two peaks, if that is less than a fraction of the lower peak and both sides are large enough.
    Rows are not looked at: people are narrow at the neck and at the waist.

    Args:
        notch: largest count between two peaks, as a fraction of the lower one.
        least: pixels of the smallest part.
    """
    labels, boxes, areas = blobs
    if not (areas >= 2 * least).any():
        return blobs
    labels, count = labels.copy(), len(areas)
    room = np.empty((count + int(areas.sum() / max(least, 1)), 5), np.int64)
    room[:count, :4], room[:count, 4] = boxes, areas
    count = split_components(labels, room, count, notch, float(least), MIN_PART_RATIO)
    return Blobs(labels, room[:count, :4].copy(), room[:count, 4].copy())


def drop_fragments(blobs: Blobs, tracks: Sequence[Track], time: float, p: TrackingParams) -> Blobs:
    """Blobs without those below `min_area_ratio` that are near a larger one, or where a larger track is expected."""
    labels, boxes, areas = blobs
    small, (height, width) = areas < p.min_area_ratio * labels.size, labels.shape
    if not small.any():
        return blobs
    around = [track.box(time, p.max_prediction_s) for track in tracks if not is_small(track, width / height, p)]
    large = np.concatenate([boxes[~small] / height, np.array(around).reshape(-1, 4)])
    keep, mine = ~small, boxes[small, None] / height
    # The larger gap of rows and columns, to the nearest of them.
    gaps = np.maximum(mine[..., :2] - large[:, 2:], large[:, :2] - mine[..., 2:]).max(2).min(1, initial=np.inf)
    keep[small] = gaps >= ISOLATION_DISTANCE
    if keep.all():
        return blobs
    number = np.zeros(len(areas) + 1, np.int32)
    number[1:][keep] = np.arange(1, keep.sum() + 1)
    return Blobs(np.take(number, labels), boxes[keep], areas[keep])


def ghosts(mask: Bools, still: Bools, grey: Floats, background: Floats, smallest: float) -> Bools | None:
    """Foreground that is a ghost, `[h, w]`: an object was there when the background was learned, and has left.

    Nothing has moved there for a while, and the edge between it and the rest is in the background, not in the image.
    None if there is none.

    Args:
        mask: foreground, and still: that where nothing has moved for a while, `[h, w]`.
        grey: the image in grey, `[h, w]`; background: `[3, h, w]`.
        smallest: pixels of the smallest ghost.
    """
    quiet = connected_components(still, smallest, 0)
    if not len(quiet.areas):
        return None
    # Nothing beyond these components is looked at.
    top, left = np.maximum(quiet.boxes[:, :2].min(0) - 3, 0)
    bottom, right = quiet.boxes[:, 2:].max(0) + 3
    window = (slice(top, bottom), slice(left, right))
    ghost = np.zeros(len(quiet.areas) + 1, np.bool_)
    find_ghosts(quiet.labels[window], mask[window], grey[window], background[:, top:bottom, left:right], ghost)
    return ghost[quiet.labels] if ghost.any() else None
