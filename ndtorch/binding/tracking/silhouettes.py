"""Whose pixels are whose: the silhouettes of tracks, and what they show of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.figures import Figure, Numbers
from ndtorch.binding.tracking.regions import Bools, Bytes, Floats, Labels
from ndtorch.binding.tracking.shades import APART, Light
from ndtorch.kernels.look_up import look_up
from ndtorch.kernels.mark_tracks import mark_tracks
from ndtorch.kernels.sightings import sightings as sightings_kernel
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.vision.camera.figures import Standing
from ndtorch.vision.camera.ground import MEAN_SIZE

Whole = TypeVar("Whole", np.uint8, np.int32)

COLOR, SHARES = slice(7, 10), slice(10, 14)
"""Where in what is measured of a silhouette these are."""


class Sighting(NamedTuple):
    """What a track gets at one step: row and column of the place in it nearest to the mean of its pixels, middle of its
    box, height and width, pixels, color, shares of white, grey, black and hues, by how many deviations of the noise its
    pixels stand out in the mean (0 where that is not asked), and whether it shares its region."""

    inner: tuple[float, float]
    place: tuple[float, float]
    extent: tuple[float, float]
    pixels: float
    color: Numbers
    shades: Numbers
    sure: float
    shared: bool


def sightings(
    figures: Sequence[Figure], silhouettes: Labels, standing: Standing, light: Light, shared: set[int]
) -> list[Sighting | None]:
    """What the silhouettes show of each track; None where they show nothing.

    How far a track stands out is asked of those that are no objects yet; what shares its region is seen nowhere by
    itself.

    Args:
        figures: the tracks.
        silhouettes: number of the track of every pixel plus one, `[h, w]`.
        standing: picture, ground and noise.
        light: of the scene.
        shared: numbers of the tracks that share a region.
    """
    height = silhouettes.shape[0]
    names = [one.number + 1 for one in figures]
    doubted = [not one.known and one.number not in shared for one in figures]
    table = measured(names, doubted, silhouettes, standing, light)
    found: list[Sighting | None] = []
    for one, row, (top, left, bottom, right, pixels, down, across, *_, sure) in zip(
        figures, table, table.tolist(), strict=True
    ):
        place, extent = ((top + bottom) / 2 / height, (left + right) / 2 / height), (bottom - top, right - left)
        size, inner = (extent[0] / height, extent[1] / height), (down / height, across / height)
        looks = pixels / height**2, row[COLOR], row[SHARES], sure, one.number in shared
        found.append(Sighting(inner, place, size, *looks) if pixels else None)
    return found


def measured(names: list[int], doubted: list[bool], silhouettes: Labels, standing: Standing, light: Light) -> Numbers:
    """What is seen of K silhouettes: top, left, bottom and right, how many pixels, row and column of the place in it
    nearest to their mean, all in pixels; color; white, grey, black and hues; and by how many deviations it stands out.

    Args:
        names: their numbers in the silhouettes.
        doubted: of which the last is asked.
        silhouettes, standing, light: as of `sightings`.

    Returns:
        `[K, 15]`, zeros where nothing is.
    """
    table = np.zeros((len(names), 15))
    if kernels_wanted():
        from ndtorch.kernels.sightings import ShadeNumbers

        slots = np.zeros(max(names, default=0) + 1, np.int32)
        slots[names] = np.arange(len(names))
        p = light.params
        numbers = ShadeNumbers(float(light.brightest), p.palest, p.pale, p.white, p.black)
        noises = (standing.picture, standing.ground, standing.deviation, standing.noise, MEAN_SIZE)
        sightings_kernel(silhouettes, slots, np.array(doubted, bool), *noises, light.balance, numbers, APART, table)
        return table
    boxes = bounds(silhouettes)
    for k, name in enumerate(names):
        if name not in boxes:
            continue
        top, left, bottom, right, _ = boxes[name]
        window = silhouettes[top:bottom, left:right] == name
        inside = standing.picture[:, top:bottom, left:right][:, window]
        rows, columns = np.nonzero(window)
        middle = np.array([rows.mean(), columns.mean()])
        n = int(((rows - middle[0]) ** 2 + (columns - middle[1]) ** 2).argmin())
        # Within that pixel the point nearest to the mean: several pixels may be as near.
        nearest = np.array([rows[n], columns[n]])
        table[k, :5] = boxes[name]
        table[k, 5:7] = middle.clip(nearest - 0.5, nearest + 0.5) + np.array([top, left]) + 0.5
        table[k, COLOR], table[k, SHARES] = inside.mean(1), light.shares(inside)
        if doubted[k]:
            table[k, 14] = stands_out(standing, (slice(None), slice(top, bottom), slice(left, right)), window)
    return table


def stands_out(standing: Standing, box: tuple[slice, slice, slice], inside: Bools) -> float:
    """By how many deviations of their noise some pixels of a box `[h', w']` stand out, in the mean."""
    apart = np.abs(standing.picture[box][:, inside] - standing.ground[box][:, inside])
    noise = np.maximum(standing.deviation[box][:, inside] * np.float32(1 / MEAN_SIZE), standing.noise[:, None])
    return float((apart / noise).max(0).mean())


def marked(silhouettes: Labels, known: list[int], keeping: list[int], most: int, kept: Floats) -> Bytes:
    """1 where known objects are, 0 elsewhere, `[h, w]`.

    Args:
        silhouettes: number of the track of every pixel plus one, `[h, w]`.
        known, keeping: numbers of tracks.
        most: of the latest track plus one.
        kept: becomes 1 where one of `keeping` is or beside it, 0 elsewhere, `[h, w]`.
    """
    import cv2

    marks = np.zeros((most + 1, 2), np.uint8)
    for column, numbers in enumerate((known, keeping)):
        for number in numbers:
            marks[number + 1, column] = 1
    if not kernels_wanted():
        kept[...] = cv2.dilate(marks[silhouettes, 1], np.ones((3, 3), np.uint8))
        return np.asarray(marks[silhouettes, 0])
    mask = np.empty(silhouettes.shape, np.uint8)
    mark_tracks(silhouettes, marks, mask, kept)
    return mask


def told(silhouettes: Labels, table: npt.NDArray[Whole]) -> npt.NDArray[Whole]:
    """What a table says of the number of every pixel, `[h, w]`."""
    if not kernels_wanted():
        return table[silhouettes]
    found = np.empty(silhouettes.shape, table.dtype)
    look_up(silhouettes, table, found)
    return found


def bounds(silhouettes: Labels) -> dict[int, tuple[int, int, int, int, int]]:
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
    picture: Floats,
    p: FigureParams,
) -> None:
    """Give each pixel of a region to one of several tracks: the nearest where they are expected, and most alike in
    color.

    Args:
        silhouettes: number of the track of every pixel plus one, `[h, w]`; is changed.
        labels: number of the region of every pixel, `[h, w]`.
        r: the region.
        box: its top, left, bottom and right.
        ones: the tracks.
        time: seconds.
        picture: `[3, h, w]`, 0..1.
        p: constants.
    """
    import cv2

    height = labels.shape[0]
    top, left, bottom, right = box.tolist()
    window = labels[top:bottom, left:right] == r + 1
    here = silhouettes[top:bottom, left:right]
    if len(ones) == 1:
        here[window] = ones[0].number + 1
        return
    rows = (np.arange(top, bottom) + 0.5)[:, None] / height
    columns = (np.arange(left, right) + 0.5)[None] / height
    # Of neighbours together: single pixels are noise.
    part = [np.asarray(cv2.blur(plane[top:bottom, left:right], (p.blurred, p.blurred))) for plane in picture]
    away = []
    for one in ones:
        place = one.expected(time, p.ahead)
        apart = ((rows - place[0]) / one.extent[0]) ** 2 + ((columns - place[1]) / one.extent[1]) ** 2
        most = np.zeros_like(part[0])
        for plane, own in zip(part, one.color.tolist(), strict=True):
            np.maximum(most, np.abs(plane - np.float32(own)), out=most)
        away.append(apart + p.own_color * most**2)
    nearest = np.array([one.number + 1 for one in ones], np.int32)[np.argmin(np.stack(away), 0)]
    here[window] = nearest[window]
