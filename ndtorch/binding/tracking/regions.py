"""Regions of a picture that stand out: what hangs together, and what is only a hole in the memory of the ground."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]


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

    mask = figure.astype(np.uint8)
    if gap:
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((gap + 1, gap + 1), np.uint8)), np.uint8)
    # What an object encloses is its own.
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    mask = np.asarray(cv2.drawContours(mask, outlines, -1, 1, cv2.FILLED), np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    stats = np.asarray(stats, np.int64)
    keep = stats[:, 4] >= smallest
    keep[0] = False
    number = np.zeros(count, np.int32)
    number[keep] = np.arange(1, keep.sum() + 1)
    rows = stats[keep]
    boxes = np.stack([rows[:, 1], rows[:, 0], rows[:, 1] + rows[:, 3], rows[:, 0] + rows[:, 2]], 1)
    return Regions(number[np.asarray(labels)], boxes, np.asarray(rows[:, 4], np.int64))


def holes(figure: Bools, still: Bools, picture: Floats, ground: Floats, smallest: float) -> Bools:
    """Where the figure is a hole in memory, `[h, w]`: nothing has moved there for a while, and the edge between it and
    the rest of the picture stands in the remembered ground, not in the picture. Something was there and has left.

    Args:
        figure: what stands out, `[h, w]`.
        still: where nothing has moved for a while, `[h, w]`.
        picture, ground: the picture and the remembered ground, grey, `[h, w]`.
        smallest: pixels of the smallest region.
    """
    import cv2

    quiet = regions_of(figure & still, smallest, 0)
    count = len(quiet.areas)
    if not count:
        return np.zeros(figure.shape, bool)
    inside = (quiet.labels > 0).astype(np.uint8)
    rim = (inside > 0) & (cv2.erode(inside, np.ones((3, 3), np.uint8)) == 0)
    # The side towards what moves says nothing: that may be the thing itself.
    outer = rim & (cv2.erode(figure.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0)
    which = quiet.labels[outer]

    def edges(image: Floats) -> npt.NDArray[np.float64]:
        across, down = cv2.Sobel(image, cv2.CV_32F, 1, 0), cv2.Sobel(image, cv2.CV_32F, 0, 1)
        size = cv2.dilate(np.abs(across) + np.abs(down), np.ones((3, 3), np.uint8))
        sums = np.bincount(which, np.asarray(size, np.float64)[outer], minlength=count + 1)
        return np.asarray(sums[1:], np.float64)

    around = np.bincount(which, minlength=count + 1)[1:]
    whole = np.bincount(quiet.labels[rim], minlength=count + 1)[1:]
    hole = (2 * around > whole) & (edges(ground) > edges(picture))
    return np.concatenate([[False], hole])[quiet.labels]
