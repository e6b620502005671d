"""Which region belongs to which track: where a track was expected, then by distance, color and size."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.figures import PIXELS, Figure, Numbers
from ndtorch.binding.tracking.regions import Floats, Regions
from ndtorch.binding.tracking.whole import clear
from ndtorch.kernels.overlaps import overlaps as overlaps_kernel
from ndtorch.kernels.switch import kernels_wanted


def visible(ones: list[Figure], area: float, p: FigureParams) -> tuple[list[Figure], list[Figure], list[Figure]]:
    """Of the tracks whose region is one: those seen in it, those hidden there, and those that were pieces of another.

    A track that runs into a known one soon after it began was a piece of it, and of such only the oldest stays. Known
    tracks that are together much smaller than their region were pieces of one thing, and so was a small one that moves
    as the largest does. Of the others, the oldest are seen for as many as there is room for; the rest is hidden.
    """
    if len(ones) < 2:
        return ones, [], []
    known = [one for one in ones if one.known]
    # One that was apart for a while, and is no small part of it, stays one of its own.
    most = max((one.last[PIXELS] for one in known or ones), default=0.0)
    known += [one for one in ones if not one.known and lasted(one, p) and p.larger * one.last[PIXELS] >= most]
    if not known:
        first = sorted(ones, key=lambda one: one.number)
        return first[:1], [], first[1:]
    parts = [one for one in ones if all(one is not other for other in known)]
    known.sort(key=lambda one: one.number)
    if len(known) > 1 and sum(one.last[PIXELS] for one in known) < area / p.larger:
        return known[:1], [], parts + known[1:]
    largest = max(known, key=lambda one: one.last[PIXELS])
    shown, hidden = list[Figure](), list[Figure]()
    for one in known:
        small = one.last[PIXELS] * p.larger < largest.last[PIXELS]
        if small and math.dist(one.velocity, largest.velocity) < p.fate * math.hypot(*largest.velocity):
            parts.append(one)
        elif not shown or sum(other.last[PIXELS] for other in shown) + p.room * one.last[PIXELS] < area:
            shown.append(one)
        else:
            hidden.append(one)
    return shown or [largest], hidden, parts


def lasted(one: Figure, p: FigureParams) -> bool:
    """Whether a track was in sight for long enough to be an object, and is no pale piece."""
    return one.last_seen - one.first_seen >= p.shortest and (not p.travel or clear(one, p))


def meeting(
    figures: list[Figure], time: float, regions: Regions, p: FigureParams
) -> tuple[dict[int, list[int]], dict[int, int]]:
    """The tracks of each region, and the track of every region that is a piece of one."""
    height = regions.labels.shape[0]
    areas = regions.areas.tolist()
    given: dict[int, list[int]] = {r: [] for r in range(len(areas))}
    pieces: dict[int, int] = {}
    if not areas or not figures:
        return given, pieces
    counts = overlaps([one.box(time, p.ahead) for one in figures], regions)
    inside, largest = counts.tolist(), [0] * len(figures)
    for k, (one, r) in enumerate(zip(figures, counts.argmax(1).tolist(), strict=True)):
        if inside[k][r] > p.shared * min(areas[r], one.last[PIXELS] * height * height):
            given[r].append(k)
            largest[k] = areas[r]
    for r, k in enumerate(counts.argmax(0).tolist()):
        # What is nearly as large as the rest of it is no piece: a group has parted.
        if not given[r] and inside[k][r] > p.piece * areas[r] and p.larger * areas[r] < largest[k]:
            pieces[r] = k
    return given, pieces


def overlaps(boxes: list[tuple[float, float, float, float]], regions: Regions) -> Numbers:
    """Pixels of each of R regions in each of K boxes, `[K, R]`; the boxes are shares of the height."""
    height, width = regions.labels.shape
    inside, pixels = np.zeros((len(boxes), len(regions.areas))), np.array(boxes) * height
    if kernels_wanted():
        overlaps_kernel(regions.labels, pixels, inside)
        return inside
    for k, box in enumerate(pixels.tolist()):
        top, left = max(0, math.floor(box[0])), max(0, math.floor(box[1]))
        bottom, right = min(height, math.ceil(box[2])), min(width, math.ceil(box[3]))
        if bottom > top and right > left:
            window = regions.labels[top:bottom, left:right]
            inside[k] = np.bincount(window.ravel(), minlength=inside.shape[1] + 1)[1:]
    return inside


def apart(
    figures: list[Figure],
    taken: set[int],
    given: dict[int, list[int]],
    regions: Regions,
    picture: Floats,
    time: float,
    p: FigureParams,
) -> list[tuple[int, int]]:
    """Pairs of tracks and regions that met nothing, by distance, color and size, the cheapest assignment."""
    from scipy.optimize import linear_sum_assignment

    lost, free = [k for k in range(len(figures)) if k not in taken], [r for r, ks in given.items() if not ks]
    if not lost or not free:
        return []
    height = regions.labels.shape[0]
    cost = np.full((len(lost), len(free)), 1e3)
    found = False
    expected = [figures[k].expected(time, p.ahead) for k in lost]
    reaches = [p.gate * figures[k].size * (1 + p.reach * (time - figures[k].last_seen)) for k in lost]
    pixels = [max(figures[k].last[PIXELS], 1e-9) for k in lost]
    for j, r in enumerate(free):
        top, left, bottom, right = regions.boxes[r].tolist()
        row, column = (top + bottom) / 2 / height, (left + right) / 2 / height
        area, color = regions.areas[r] / height**2, None
        for i, k in enumerate(lost):
            if not 1 / p.alike_size < area / pixels[i] < p.alike_size:
                continue
            value = math.hypot(row - expected[i][0], column - expected[i][1]) / reaches[i]
            if value >= 1:
                continue
            if color is None:
                window = regions.labels[top:bottom, left:right] == r + 1
                color = picture[:, top:bottom, left:right][:, window].mean(1)
            value += p.unlike * float(np.abs(color - figures[k].color).max())
            if value < 1:
                cost[i, j], found = value, True
    if not found:
        return []
    rows, columns = linear_sum_assignment(cost)
    return [(lost[i], free[j]) for i, j in zip(rows, columns, strict=True) if cost[i, j] < 1]
