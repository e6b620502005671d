"""Whose pixels are whose: the silhouettes of tracks, and what they show of each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.binding.tracking.figures import Figure, Numbers
from ndtorch.binding.tracking.regions import Floats, Labels
from ndtorch.binding.tracking.shades import Light


class Sighting(NamedTuple):
    """What a track gets at one step: row and column of the place in it nearest to the mean of its pixels, middle of its
    box, height and width, pixels, color, shares of white, grey, black and hues, and whether it shares its region."""

    inner: Numbers
    place: Numbers
    extent: Numbers
    pixels: float
    color: Numbers
    shades: Numbers
    shared: bool


def bounds(silhouettes: Labels, count: int) -> dict[int, tuple[int, int, int, int, int]]:
    """Top, left, bottom, right and pixels of every silhouette, by its number plus one."""
    rows, columns = np.nonzero(silhouettes)
    if not len(rows):
        return {}
    names = silhouettes[rows, columns]
    found, where, number = np.unique(names, return_inverse=True, return_counts=True)
    n = len(found)
    top, left = np.full(n, 1 << 30), np.full(n, 1 << 30)
    bottom, right = np.zeros(n, np.int64), np.zeros(n, np.int64)
    np.minimum.at(top, where, rows)
    np.minimum.at(left, where, columns)
    np.maximum.at(bottom, where, rows + 1)
    np.maximum.at(right, where, columns + 1)
    parts = zip(found, top, left, bottom, right, number, strict=True)
    return {int(name): (int(t), int(u), int(b), int(v), int(m)) for name, t, u, b, v, m in parts}


def share(
    silhouettes: Labels,
    labels: Labels,
    r: int,
    box: npt.NDArray[np.int64],
    ones: list[Figure],
    time: float,
    ahead: float,
) -> None:
    """Give each pixel of a region to the nearest of several tracks, where they are expected."""
    height = labels.shape[0]
    top, left, bottom, right = box
    rows = (np.arange(top, bottom) + 0.5)[:, None] / height
    columns = (np.arange(left, right) + 0.5)[None] / height
    away = []
    for one in ones:
        place = one.expected(time, ahead)
        away.append(((rows - place[0]) / one.extent[0]) ** 2 + ((columns - place[1]) / one.extent[1]) ** 2)
    nearest = np.array([one.number + 1 for one in ones], np.int32)[np.argmin(np.stack(away), 0)]
    window = labels[top:bottom, left:right] == r + 1
    silhouettes[top:bottom, left:right][window] = nearest[window]


def sighting(
    one: Figure,
    silhouettes: Labels,
    boxes: dict[int, tuple[int, int, int, int, int]],
    picture: Floats,
    light: Light,
    shared: bool,
) -> Sighting | None:
    """What the silhouettes show of a track; None if nothing."""
    if one.number + 1 not in boxes:
        return None
    height = silhouettes.shape[0]
    top, left, bottom, right, pixels = boxes[one.number + 1]
    window = silhouettes[top:bottom, left:right] == one.number + 1
    inside = picture[:, top:bottom, left:right][:, window]
    color = inside.mean(1).astype(np.float64)
    place = np.array([(top + bottom) / 2, (left + right) / 2]) / height
    extent = np.array([bottom - top, right - left]) / height
    rows, columns = np.nonzero(window)
    middle = np.array([rows.mean(), columns.mean()])
    k = int(((rows - middle[0]) ** 2 + (columns - middle[1]) ** 2).argmin())
    # Within that pixel the point nearest to the mean: several pixels may be as near.
    nearest = np.array([rows[k], columns[k]])
    inner = (middle.clip(nearest - 0.5, nearest + 0.5) + np.array([top, left]) + 0.5) / height
    return Sighting(inner, place, extent, pixels / height**2, color, light.shares(inside), shared)
