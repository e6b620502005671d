"""Regions of one color, and images that are shifted and compared: what `ndtorch.tracking.layers` is made of."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

Image = npt.NDArray[np.int32]
Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Labels = npt.NDArray[np.int32]
Shift = tuple[int, int]


def misfit(image: Any, low: Any, high: Any, most: float) -> Floats:
    """How far colors lie outside bounds, `[...]`: the channel that does most."""
    return np.asarray(np.minimum(np.maximum(np.maximum(image - high, low - image), 0).max(-1), most))


def half_pixel_bounds(image: Image) -> tuple[Floats, Floats]:
    """Least and greatest color within half a pixel of each, `[H, W, 3]`.

    With these a displacement by a fraction of a pixel costs nothing (Birchfield & Tomasi 1998).
    """
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    height, width = image.shape[:2]
    around = [(padded[a : a + height, b : b + width] + image) / 2 for a in range(3) for b in range(3)]
    return np.minimum.reduce(around), np.maximum.reduce(around)


def shifted(array: npt.NDArray[Any], shift: Shift, fill: float = 0) -> npt.NDArray[Any]:
    """An array `[H, W, ...]` moved by rows and columns, with `fill` where nothing comes from."""
    moved = np.full_like(array, fill)
    height, width = array.shape[:2]
    a, b = shift
    if abs(a) < height and abs(b) < width:
        moved[max(a, 0) : height + min(a, 0), max(b, 0) : width + min(b, 0)] = array[
            max(-a, 0) : height - max(a, 0), max(-b, 0) : width - max(b, 0)
        ]
    return moved


def commonest_color(image: Image, ratio: float) -> npt.NDArray[np.int32] | None:
    """The commonest color `[3]` of an image `[H, W, 3]`, if it fills at least that fraction of it."""
    colors, counts = np.unique(image.reshape(-1, 3), axis=0, return_counts=True)
    most = counts.argmax()
    return np.asarray(colors[most]) if counts[most] >= ratio * image[..., 0].size else None


def color_parts(image: Image, same: int, where: Mask | None = None) -> Labels:
    """Labels from 1 of connected parts in which neighbours differ by at most `same`, `[H, W]`; 0 outside `where`."""
    size = image.shape[:2]
    where = np.ones(size, bool) if where is None else where
    index = np.arange(where.size).reshape(size)
    down = (np.abs(image[1:] - image[:-1]).max(-1) <= same) & where[1:] & where[:-1]
    across = (np.abs(image[:, 1:] - image[:, :-1]).max(-1) <= same) & where[:, 1:] & where[:, :-1]
    ends = np.concatenate([index[1:][down], index[:, 1:][across]])
    starts = np.concatenate([index[:-1][down], index[:, :-1][across]])
    graph = coo_array((np.ones(len(ends), bool), (starts, ends)), shape=(where.size, where.size))
    parts = connected_components(graph, directed=False)[1].reshape(size) + 1
    return np.where(where, parts, 0).astype(np.int32)


def moved_parts(parts: Labels, recent: Mask, min_area: int, rim_ratio: float) -> Mask:
    """Where parts of one color, a fifth of the image at most, have won pixels on one side and lost some on the other.

    A part that moves by one pixel changes half of its inner and half of its outer rim. Both fractions must be .12 at
    least, and `rim_ratio` together.
    """
    n = int(parts.max()) + 1
    inner = np.zeros(parts.shape, bool)
    outer, lost = np.zeros(n), np.zeros(n)
    for one, two in ((np.s_[1:, :], np.s_[:-1, :]), (np.s_[:, 1:], np.s_[:, :-1])):
        for here, there in ((one, two), (two, one)):
            edge = parts[here] != parts[there]
            inner[here] |= edge
            outer += np.bincount(parts[here][edge], minlength=n)
            lost += np.bincount(parts[here][edge & recent[there]], minlength=n)
    area, rim = np.bincount(parts.ravel(), minlength=n), np.bincount(parts[inner], minlength=n)
    gain = np.bincount(parts[inner & recent], minlength=n) / np.maximum(rim, 1)
    loss = lost / np.maximum(outer, 1)
    moved = (np.minimum(gain, loss) >= 0.12) & (gain + loss >= rim_ratio)
    return np.isin(parts, np.nonzero(moved & (area >= min_area) & (area < 0.2 * parts.size))[0])
