"""Ghosts: where an object stood before it left. What stands from the first frame on is background at first.

It is detected as it walks off. Its ghost lies where it stood, and looks there as the first image of the scene does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ndtorch.foreground.arrays import Bools, Floats, Numbers
from ndtorch.foreground.segmentation import Segmentation
from ndtorch.tracking.blobs import connected_components
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.track import DETECTION, PIXELS, PLACE, Track

TRACED_S, CLEAR_S = 10.0, 3.0
"""A track left a ghost if it began at most so many seconds before or after it was found, where no object had passed for
so many seconds: in a queue of cars ghosts are seldom what they seem."""
GHOST = 15
"""Numbers kept of a ghost: time at which it was found, row and column, top, left, bottom and right, pixels, number of
the object or -1, and the colors of the background and of the image there."""
REACH_SIZES = 2.0
"""It began at most so many of its sizes away: it is in one blob with its ghost at first."""
MIN_PART = 0.15
"""This share of its area is enough for a ghost within one size where no object ever passed: some of it was learned."""
PIECES_S, PIECES_PX = 2.0, 3
"""What leaves slowly uncovers its ghost in pieces: they are found within this time and distance of one another."""


def recent_ghosts(known: Numbers, ghost: Bools, first: Floats, seen: Segmentation, time: float) -> Numbers:
    """The ghosts found lately, `[N, 15]`, with those of a mask `[h, w]` that were there when the scene began.

    Args:
        first: image of the scene, `[3, h, w]`, and seen: segmentation of this frame.
    """
    found, height, rows = connected_components(ghost, 0, 0), len(ghost), list(known)
    for r, (box, area) in enumerate(zip(found.boxes, found.areas.tolist(), strict=True)):
        inside = found.labels == r + 1
        was, before, now = (plane[:, inside] for plane in (seen.background, first, seen.image))
        if np.abs(was - before).mean() > np.abs(was - now).mean() / 2:
            continue
        pixels, colors = area / height**2, np.concatenate([was.mean(1), now.mean(1)])
        low, high, near, given = box[:2] / height, box[2:] / height, PIECES_PX / height, -1.0
        for k in reversed(range(len(rows))):
            upper, lower = rows[k][3:5], rows[k][5:7]
            if time - rows[k][0] < PIECES_S and (low <= lower + near).all() and (upper <= high + near).all():
                colors = (pixels * colors + rows[k][7] * rows[k][9:]) / (pixels + rows[k][7])
                pixels, given = pixels + rows[k][7], max(given, rows[k][8])
                low, high = np.minimum(low, upper), np.maximum(high, lower)
                del rows[k]
        rows.append(np.array((time, *(low + high) / 2, *low, *high, pixels, given, *colors)))
    return np.array(rows).reshape(-1, GHOST)


def trace_back(ghosts: Numbers, tracks: Sequence[Track], began: float, time: float, p: TrackingParams) -> Numbers:
    """Each ghost `[N, 15]` goes to the object about as large that began nearest to it; those not too old are returned.

    Which of the tracks around it is the object that left is known a while later, so all are assigned at every step.
    Its color is that which the background had there, not that of the image.

    Args:
        began: time at which the scene began.
    """
    given = set(ghosts[:, 8].tolist())
    for one in tracks:
        if one.number in given:
            one.waited = np.zeros(DETECTION)
    able = [one for one in tracks if one.is_object and one.first_seen - one.passed_at > CLEAR_S]
    for ghost in ghosts:
        found, place, pixels, nearest, ghost[8] = float(ghost[0]), ghost[1:3].tolist(), float(ghost[7]), math.inf, -1
        for one in able:
            if one.waited[PIXELS] or abs(found - one.first_seen) >= TRACED_S:
                continue
            away = math.dist(place, one.first[PLACE])
            if away >= min(nearest, REACH_SIZES * one.size):
                continue
            was, now = np.abs(one.color - ghost[9:].reshape(2, 3)).mean(1)
            least = MIN_PART if one.passed_at < began and away < one.size else 1 / p.max_area_ratio
            if was <= now and least < pixels / np.median(one.path[:, PIXELS]) < p.max_area_ratio:
                best, nearest = one, away
        if nearest < math.inf:
            best.waited, ghost[8] = np.array((began, *ghost[1:8], *place)), best.number
    return ghosts[time - ghosts[:, 0] < TRACED_S]
