"""Splits of groups: place, color and size say which track leaves with which blob."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ndtorch.foreground.arrays import Floats, Numbers
from ndtorch.tracking.association import MIN_AGE_S, NEVER, Association, pair_costs
from ndtorch.tracking.blobs import Blobs
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.track import PARKED_S, Track, stands

MAX_COST = 1.5
"""A track leaves a group at no more than this cost, and only if it was followed for `MIN_AGE_S`."""
STAY, LEAVE = 20.0, 10.0
"""Rewards for a track that keeps the group's blob, and for one that gets another blob. They are larger than any cost of
a pair, so costs only say who goes where."""


def resolve_splits(
    tracks: Sequence[Track], found: Association, blobs: Blobs, image: Floats, time: float, p: TrackingParams
) -> None:
    """Give tracks of groups to unmatched blobs beside them; `found` is changed.

    All tracks of a group meet the largest blob that is left of it, so the others would begin new tracks. Their colors
    are those from before the group merged: in a group they are not learned. A parked one stays.
    """
    free = found.unmatched_blobs
    for r, ks in found.tracks.items() if free else ():
        group = [k for k in ks if is_separate(tracks[k])]
        if len(group) < 2:
            continue
        ones = [tracks[k] for k in group]
        left = pair_costs(ones, free, blobs, image, time, p.split_color_cost, MAX_COST, p)
        left[[stands(one, time, PARKED_S) for one in ones]] = NEVER
        near = np.flatnonzero((left < NEVER).any(0))
        if not len(near):
            continue
        others, left = [free[n] for n in near.tolist()], left[:, near]
        stay = pair_costs(ones, [r], blobs, image, time, p.split_color_cost, math.inf, p).clip(max=MAX_COST)
        for i, j in assign_split(left, stay):
            found.tracks[r].remove(group[i])
            found.tracks[others[j]].append(group[i])
            free.remove(others[j])


def is_separate(track: Track) -> bool:
    """Whether a track is an object for long enough: fragments of one object merge and split all the time."""
    return track.is_object and track.age >= MIN_AGE_S


def assign_split(left: Numbers, stay: Numbers) -> list[tuple[int, int]]:
    """Which tracks leave a group of K for which of R blobs, at the lowest cost of all together.

    Args:
        left: costs of leaving, `[K, R]`.
        stay: costs of staying, `[K, 1]`. One stays.

    Returns:
        pairs of a track and a blob.
    """
    from scipy.optimize import linear_sum_assignment

    table = np.concatenate([np.where(left < NEVER, left - LEAVE, NEVER), np.repeat(stay, len(left), 1)], 1)
    table[:, left.shape[1]] -= STAY
    rows, columns = linear_sum_assignment(table)
    pairs = [(int(i), int(j)) for i, j in zip(rows, columns, strict=True)]
    return [(i, j) for i, j in pairs if j < left.shape[1] and left[i, j] < NEVER]
