"""Who goes where when a group parts: by place, color and size."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.figures import PIXELS, Figure
from ndtorch.binding.tracking.regions import Floats, Regions

NEVER = 1e3
"""Cost of what cannot be."""
FIRST, SECOND = 20.0, 10.0
"""What it is worth that the region of the group keeps one of its tracks, and that another region gets one. More than
any cost of a pair, so that costs only say who goes where."""


def parting(
    figures: list[Figure],
    given: dict[int, list[int]],
    pieces: dict[int, int],
    regions: Regions,
    picture: Floats,
    time: float,
    p: FigureParams,
) -> None:
    """Give tracks of groups to regions beside them that nobody met.

    All tracks of a group meet the largest region that is left of it, so the others would begin new tracks. The colors
    are those from before the group met: in a group they are not learned.

    Args:
        figures: open tracks.
        given: the tracks of each region; is changed.
        pieces: the track of every region that is a piece of one.
        regions: of this step.
        picture: `[3, h, w]`, 0..1.
        time: seconds.
        p: constants.
    """
    free = [r for r, ones in given.items() if not ones and r not in pieces]
    for r, ones in given.items() if free else ():
        group = [k for k in ones if of_its_own(figures[k], p)]
        if len(group) < 2:
            continue
        left = costs([figures[k] for k in group], free, regions, picture, time, p)
        near = np.flatnonzero((left < NEVER).any(0))
        if not len(near):
            continue
        others, left = [free[n] for n in near.tolist()], left[:, near]
        stay = costs([figures[k] for k in group], [r], regions, picture, time, p, alike=False).clip(max=p.leaves)
        for i, j in assigned(left, stay):
            given[r].remove(group[i])
            given[others[j]].append(group[i])
            free.remove(others[j])


def of_its_own(one: Figure, p: FigureParams) -> bool:
    """Whether a track is an object for long enough: pieces of one thing come together and part all the time."""
    return one.known and one.last_seen - one.first_seen >= p.familiar


def assigned(left: Floats, stay: Floats) -> list[tuple[int, int]]:
    """Which tracks leave a group of K for which of R regions, at the lowest cost of all together.

    Args:
        left: costs of leaving, `[K, R]`.
        stay: of staying, `[K, 1]`. One stays.

    Returns:
        pairs of a track and a region.
    """
    from scipy.optimize import linear_sum_assignment

    table = np.concatenate([np.where(left < NEVER, left - SECOND, NEVER), np.repeat(stay, len(left), 1)], 1)
    table[:, left.shape[1]] -= FIRST
    rows, columns = linear_sum_assignment(table)
    pairs = [(int(i), int(j)) for i, j in zip(rows, columns, strict=True)]
    return [(i, j) for i, j in pairs if j < left.shape[1] and left[i, j] < NEVER]


def costs(
    ones: list[Figure],
    where: list[int],
    regions: Regions,
    picture: Floats,
    time: float,
    p: FigureParams,
    alike: bool = True,
) -> Floats:
    """What it costs that a track is in a region, `[K, R]`: its distance in sizes and seconds, and another color.

    Args:
        ones: K tracks.
        where: R regions.
        regions, picture, time, p: as of `parting`.
        alike: whether another size, or more than `leaves`, is `NEVER`.
    """
    height = regions.labels.shape[0]
    found = np.full((len(ones), len(where)), NEVER, np.float32)
    for j, r in enumerate(where):
        top, left, bottom, right = regions.boxes[r].tolist()
        row, column, area = (top + bottom) / 2 / height, (left + right) / 2 / height, regions.areas[r] / height**2
        color = None
        for i, one in enumerate(ones):
            if alike and not 1 / p.alike_size < area / max(one.last[PIXELS], 1e-9) < p.alike_size:
                continue
            there = one.expected(time, p.ahead)
            reach = p.gate * one.size * (1 + p.reach * (time - one.last_seen))
            value = math.hypot(row - there[0], column - there[1]) / reach
            if alike and value >= p.leaves:
                continue
            if color is None:
                window = regions.labels[top:bottom, left:right] == r + 1
                color = picture[:, top:bottom, left:right][:, window].mean(1)
            value += p.known_by * float(np.abs(color - one.color).max())
            if not alike or value < p.leaves:
                found[i, j] = value
    return found
