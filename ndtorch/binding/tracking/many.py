"""Where many things of a size come: snow and rain all over the picture, glints on a part of it. One of them is none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from torch import Tensor

from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.figures import FOLLOWED, PIXELS, Figure, Numbers
from ndtorch.binding.tracking.restless import near

COMING = 5
"""Numbers kept of a track that came: its number, time, row and column where it came, and the root of its pixels."""


class Comings(NamedTuple):
    """The tracks that came lately, as they are in a state: `rows` is `[N, 5]` float64, N depends on the run."""

    rows: Tensor


def comings(
    before: Numbers, figures: Sequence[Figure], late: Sequence[Figure], time: float, p: FigureParams
) -> Numbers:
    """The tracks that came lately, `[N, 5]`, those beside a larger object left out: pieces and shadows come with it.

    A track is told once, when it has been in sight for `shortest`: by then it is known what is an object beside it. One
    that went before is told when it is given up.

    Args:
        before: a step ago.
        figures: open tracks.
        late: tracks that were out of sight for too long at this step.
        time: seconds.
        p: constants.
    """
    kept = before[time - before[:, 1] < p.lately] if len(before) else before
    new = [one for one in figures if one.last_seen == time and came(one, p)]
    # What lasted for a glimpse is noise.
    new += [one for one in late if p.glimpse < one.last_seen - one.first_seen <= p.shortest]
    if not new:
        return kept
    objects, rows = [one for one in figures if one.known], []
    for one in new:
        path = one.path
        most = p.larger * path[:, PIXELS].max()
        if not any(other.last[PIXELS] > most and near(path, other, p) for other in objects):
            place = path[0, FOLLOWED].tolist()
            rows.append((one.number, one.first_seen, *place, size_of(path, 0.5)))
    return np.concatenate([kept, np.array(rows).reshape(-1, COMING)])


def size_of(path: Numbers, share: float) -> float:
    """Side of a square of as many pixels as a track `[n, 10]` had at most in that share of its sightings."""
    return math.sqrt(np.sort(path[:, PIXELS])[int(share * len(path))])


def came(one: Figure, p: FigureParams) -> bool:
    """Whether a track has been in sight for longer than `shortest` for the first time."""
    if not one.late or len(one.before) + len(one.late) < 2:
        return False
    previous = one.late[-2][0] if len(one.late) > 1 else float(one.before[-1, 0])
    return previous - one.first_seen <= p.shortest < one.last_seen - one.first_seen


def one_of_many(one: Figure, come: Numbers, seen_for: float, width: float, p: FigureParams) -> bool:
    """Whether many of its size came lately: everywhere, or fewer of them close together around it.

    A busy road has things of a size too, but not as many, and its small things are pieces of larger ones.

    Args:
        one: the track.
        come: of `comings`.
        seen_for: seconds since the scene began.
        width: of the picture, as a share of its height.
        p: constants.
    """
    if not p.travel or len(come) < p.several:
        return False
    # What began a scene came at once: that is no pace.
    span = max(1.0, min(seen_for, p.lately))
    row, column = one.last[FOLLOWED]
    tall = min(row + p.among, 1.0) - max(row - p.among, 0.0)
    wide = min(column + p.among, width) - max(column - p.among, 0.0)
    beside = (np.abs(come[:, 2] - row) < p.among) & (np.abs(come[:, 3] - column) < p.among)
    # Mostly they are too few, of whatever size.
    pace, crowd = p.many * span * width, max(p.several - 1, p.crowded * span * tall * wide)
    if len(come) <= pace and int(beside.sum()) <= crowd:
        return False
    # Glints join and part; what leaves the picture is small at last.
    size = size_of(one.path, 0.25)
    alike = (come[:, 4] > size / p.same_size) & (come[:, 4] < size * p.same_size) & (come[:, 0] != one.number)
    everywhere = int(alike.sum())
    if everywhere < p.several:
        return False
    return everywhere > pace or int((alike & beside).sum()) > crowd
