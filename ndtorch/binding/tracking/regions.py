"""Regions of a picture that stand out: what hangs together, and what is only a hole in the memory of the ground."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.kernels.count_marked import count_marked
from ndtorch.kernels.join_pixels import join_pixels
from ndtorch.kernels.part_regions import part_regions
from ndtorch.kernels.still_of import still_of as still_of_kernel
from ndtorch.kernels.switch import kernels_wanted

Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]
Labels = npt.NDArray[np.int32]


PART = 0.2
"""Smallest share of a region that is cut off."""


class Regions(NamedTuple):
    """N connected regions.

    Attributes:
        labels: number of the region of every pixel from 1, 0 where none is, `[h, w]`.
        boxes: top, left, bottom and right of each, pixels, `[N, 4]`.
        areas: pixels of each, `[N]`.
    """

    labels: Labels
    boxes: npt.NDArray[np.int64]
    areas: npt.NDArray[np.int64]


def regions_of(figure: Bools, smallest: float, gap: int) -> Regions:
    """Connected regions of at least `smallest` pixels; gaps of up to `gap` pixels are closed and
    what they enclose is filled."""
    import cv2

    mask = figure.view(np.uint8)
    if not cv2.countNonZero(mask):
        none = np.zeros(0, np.int64)
        return Regions(np.zeros(figure.shape, np.int32), none.reshape(0, 4), none)
    if gap:
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((gap + 1, gap + 1), np.uint8)), np.uint8)
    if kernels_wanted():
        names = np.empty(mask.shape, np.int32)
        found = np.empty((((len(mask) + 1) // 2) * ((mask.shape[1] + 1) // 2), 5), np.int64)
        number = join_pixels(mask, float(smallest), names, found)
        return Regions(names, found[:number, :4].copy(), found[:number, 4].copy())
    # What an object encloses is its own.
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    mask = np.asarray(cv2.drawContours(mask.copy(), outlines, -1, 1, cv2.FILLED), np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    stats = np.asarray(stats, np.int64)
    keep = stats[:, 4] >= smallest
    keep[0] = False
    numbers = np.zeros(count, np.int32)
    numbers[keep] = np.arange(1, keep.sum() + 1)
    rows = stats[keep]
    boxes = np.stack([rows[:, 1], rows[:, 0], rows[:, 1] + rows[:, 3], rows[:, 0] + rows[:, 2]], 1)
    return Regions(numbers[np.asarray(labels)], boxes, np.asarray(rows[:, 4], np.int64))


def parted(regions: Regions, notch: float, least: float) -> Regions:
    """Regions cut where they are narrow: things that stand or drive side by side, and hang together by little.

    The pixels of a region are counted column by column, and smoothed over an eighth of its height. It is cut at the
    smallest count between two peaks, where that is less than a share of the lower one and both sides are large
    enough. Rows are left: people are narrow at the neck and at the waist.

    Args:
        regions: of a picture.
        notch: largest count between two peaks, as a share of the lower one.
        least: pixels of the smallest part.
    """
    labels, boxes, areas = regions
    if not (areas >= 2 * least).any():
        return regions
    if kernels_wanted():
        labels, count = labels.copy(), len(areas)
        room = np.empty((count + int(areas.sum() / max(least, 1)), 5), np.int64)
        room[:count, :4], room[:count, 4] = boxes, areas
        count = part_regions(labels, room, count, notch, float(least), PART)
        return Regions(labels, room[:count, :4].copy(), room[:count, 4].copy())
    found_boxes, found_areas = boxes.tolist(), areas.tolist()
    todo = [r for r, area in enumerate(found_areas) if area >= 2 * least]
    while todo:
        r = todo.pop()
        top, left, bottom, right = found_boxes[r]
        inside = labels[top:bottom, left:right] == r + 1
        at = narrow(inside.sum(0), max(1, (bottom - top) // 8), notch, max(least, PART * found_areas[r]))
        if not at:
            continue
        if len(found_areas) == len(areas):
            labels = labels.copy()
        for name, start, half in ((r, left, inside[:, :at]), (len(found_areas), left + at, inside[:, at:])):
            rows, columns = np.flatnonzero(half.any(1)), np.flatnonzero(half.any(0))
            found = [top + rows[0], start + columns[0], top + rows[-1] + 1, start + columns[-1] + 1]
            if name == r:
                found_boxes[r], found_areas[r] = found, int(half.sum())
            else:
                found_boxes.append(found)
                found_areas.append(int(half.sum()))
                labels[top:bottom, start : start + half.shape[1]][half] = name + 1
            todo.append(name)
    return Regions(labels, np.array(found_boxes, np.int64).reshape(-1, 4), np.array(found_areas, np.int64))


def shares(labels: Labels, marked: Bytes, most: int) -> npt.NDArray[np.float64]:
    """Share of the pixels of every number up to `most` that are marked, 1 and not 0, `[most + 1]`."""
    if kernels_wanted():
        counts, areas = np.zeros(most + 1, np.int64), np.zeros(most + 1, np.int64)
        count_marked(labels, marked, counts, areas)
    else:
        counts = np.bincount(labels.ravel(), marked.ravel(), minlength=most + 1)
        areas = np.bincount(labels.ravel(), minlength=most + 1)
    return np.asarray(counts / np.maximum(areas, 1))


def narrow(counts: npt.NDArray[np.int64], width: int, notch: float, least: float) -> int:
    """Where a profile is cut in two, 0 for nowhere: at the deepest of its notches that leaves enough on both sides."""
    # An odd width, and the narrowest column goes to the smaller part: the cut of a mirror image is mirrored.
    width = 2 * (min(width, len(counts) - 1) // 2) + 1
    # In whole numbers, so that equal ones are equal.
    smooth = np.convolve(counts, np.ones(width, np.int64), "same")
    before, after = np.maximum.accumulate(smooth), np.maximum.accumulate(smooth[::-1])[::-1]
    lower = np.minimum(before, after)
    one = np.cumsum(counts) - counts
    other = counts.sum() - counts - one
    depth = np.where((one >= least) & (other >= least), smooth / np.maximum(lower, width), 1.0)
    lowest = np.flatnonzero(depth <= depth.min() + 1e-9)
    pair = lowest[[(len(lowest) - 1) // 2, len(lowest) // 2]]
    at = int(pair[np.abs(one - other)[pair].argmin()])
    if depth[at] >= notch:
        return 0
    return at if one[at] >= other[at] else at + 1


def still_of(figure: Bools, quiet: Floats, least: float, silhouettes: Labels, moving: Bytes) -> int:
    """How many pixels stand out, have been still for at least so many seconds, and are no part of what moves.

    Args:
        figure: what stands out, and quiet: seconds without motion, `[h, w]`.
        least: such seconds.
        silhouettes: number of the track of every pixel plus one, `[h, w]`.
        moving: 1 for those that move, by that number.
    """
    if kernels_wanted():
        return int(still_of_kernel(figure, quiet, least, silhouettes, moving))
    return int((figure & (quiet >= np.float32(least)) & (moving[silhouettes] == 0)).sum())


def holes(figure: Bools, still: Bools, picture: Floats, ground: Floats, smallest: float) -> Bools | None:
    """Where the figure is a hole in memory, `[h, w]`: nothing has moved there for a while, and the edge between it and
    the rest of the picture stands in the remembered ground, not in the picture. Something was there and has left. None
    where there is none.

    Args:
        figure: what stands out, `[h, w]`.
        still: where nothing has moved for a while, `[h, w]`.
        picture, ground: the picture in grey, `[h, w]`, and the remembered ground, `[3, h, w]`.
        smallest: pixels of the smallest region.
    """
    import cv2

    quiet = regions_of(figure & still, smallest, 0)
    if not len(quiet.areas):
        return None
    count = len(quiet.areas)
    # Nothing beyond these regions is looked at.
    top, left = np.maximum(quiet.boxes[:, :2].min(0) - 3, 0)
    bottom, right = quiet.boxes[:, 2:].max(0) + 3
    window = (slice(top, bottom), slice(left, right))
    names = quiet.labels[window]
    inside = (names > 0).astype(np.uint8)
    square = np.ones((3, 3), np.uint8)
    rim = (inside > 0) & (cv2.erode(inside, square) == 0)
    # The side towards what moves says nothing: that may be the thing itself.
    outer = rim & (cv2.erode(figure[window].astype(np.uint8), square) == 0)
    which = names[outer]

    def edges(part: Floats) -> npt.NDArray[np.float64]:
        across, down = cv2.Sobel(part, cv2.CV_32F, 1, 0), cv2.Sobel(part, cv2.CV_32F, 0, 1)
        size = cv2.dilate(np.abs(across) + np.abs(down), square)
        sums = np.bincount(which, np.asarray(size, np.float64)[outer], minlength=count + 1)
        return np.asarray(sums[1:], np.float64)

    around = np.bincount(which, minlength=count + 1)[1:]
    whole = np.bincount(names[rim], minlength=count + 1)[1:]
    hole = (2 * around > whole) & (edges(ground[:, top:bottom, left:right].mean(0)) > edges(picture[window]))
    if not hole.any():
        return None
    return np.concatenate([[False], hole])[quiet.labels]
