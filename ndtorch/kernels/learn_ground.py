"""One pass in which the ground and its noise follow the picture."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.inner import apart


def learn_ground(
    picture: Array,
    ground: Array,
    deviation: Array,
    noise: Array,
    kept: Array,
    quiet: Array,
    known: Array,
    needed: float,
    dt: float,
    a_ground: float,
    a_noise: float,
    hold: float,
    surprise: float,
    mean_size: float,
    new_ground: Array,
    new_deviation: Array,
    new_known: Array,
) -> None:
    """See `ndtorch.vision.camera.figures.learn`.

    Args:
        picture, ground, deviation: `[3, h, w]`.
        noise: of each color, `[3]`.
        kept, quiet, known: `[h, w]`.
        needed: seconds without motion after which the ground is known.
        dt, a_ground, a_noise, hold, surprise, mean_size: time step and constants.
        new_ground, new_deviation: become those after the step, `[3, h, w]`.
        new_known: likewise, `[h, w]`.
    """
    kind, width = picture.dtype.type, picture.shape[2]
    pace, slow, cap = np.empty(width, kind), np.empty(width, kind), np.empty(width, kind)
    for y in range(picture.shape[1]):
        paces(kept[y], quiet[y], known[y], needed, (dt, a_ground, a_noise, hold), pace, slow, cap, new_known[y])
        for c in range(3):
            follow_row(
                picture[c, y],
                ground[c, y],
                deviation[c, y],
                (noise[c], surprise, mean_size),
                pace,
                slow,
                cap,
                new_ground[c, y],
                new_deviation[c, y],
            )


@apart
def paces(
    kept: Array,
    quiet: Array,
    known: Array,
    needed: float,
    shares: tuple[float, float, float, float],
    pace: Array,
    slow: Array,
    fresh: Array,
    new_known: Array,
) -> None:
    """Paces of the ground and of its noise in one row, and 1 where the ground becomes known, 0 elsewhere."""
    kind = pace.dtype.type
    step, share, follow, held, one = kind(shares[0]), kind(shares[1]), kind(shares[2]), kind(1 - shares[3]), kind(1)
    for x in range(pace.shape[0]):
        free = one - held * kept[x]
        before = known[x] > 0
        settled = before | (quiet[x] >= needed)
        new_known[x] = settled
        pace[x] = share * free if before else step / (quiet[x] + step)
        slow[x] = follow * free if before else follow
        fresh[x] = settled & (not before)


@apart
def follow_row(
    picture: Array,
    ground: Array,
    deviation: Array,
    limits: tuple[float, float, float],
    pace: Array,
    slow: Array,
    fresh: Array,
    new_ground: Array,
    new_deviation: Array,
) -> None:
    """The ground and its noise follow one color of one row.

    Loops are made of vector instructions only as no array overlaps one that is written to.
    """
    kind = new_ground.dtype.type
    least, most, usual = kind(limits[0]), kind(limits[1]), kind(limits[2])
    for x in range(new_ground.shape[0]):
        difference, own = picture[x] - ground[x], deviation[x]
        own = own + slow[x] * (min(abs(difference), most * max(least, own)) - own)
        new_deviation[x] = min(own, least * usual) if fresh[x] > 0 else own
        new_ground[x] = ground[x] + pace[x] * difference
