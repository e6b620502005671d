"""One pass in which the ground and its noise follow the picture."""

from __future__ import annotations

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
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
) -> None:
    """See `ndtorch.vision.camera.figures.learn`.

    Args:
        picture: `[3, h, w]`.
        ground, deviation: likewise; they become those after the step.
        noise: of each color, `[3]`.
        kept, quiet: `[h, w]`.
        known: likewise; becomes that after the step.
        needed: seconds without motion after which the ground is known.
        dt, a_ground, a_noise, hold, surprise, mean_size: time step and constants.
    """
    kind, width = picture.dtype.type, picture.shape[2]
    pace, slow, cap = np.empty(width, kind), np.empty(width, kind), np.empty(width, kind)
    for y in range(picture.shape[1]):
        paces(kept[y], quiet[y], known[y], needed, (dt, a_ground, a_noise, hold), pace, slow, cap)
        for c in range(3):
            follow_row(
                picture[c, y],
                ground[c, y],
                deviation[c, y],
                (noise[c], surprise, mean_size),
                pace,
                slow,
                cap,
            )


@jit
def paces(
    kept: Array,
    quiet: Array,
    known: Array,
    needed: float,
    shares: tuple[float, float, float, float],
    pace: Array,
    slow: Array,
    fresh: Array,
) -> None:
    """Paces of the ground and of its noise in one row, and 1 where the ground becomes known, 0 elsewhere."""
    kind = pace.dtype.type
    step, share, follow, held, one = kind(shares[0]), kind(shares[1]), kind(shares[2]), kind(1 - shares[3]), kind(1)
    for x in range(pace.shape[0]):
        free = one - held * kept[x]
        before = known[x] > 0
        settled = before | (quiet[x] >= needed)
        known[x] = settled
        pace[x] = share * free if before else step / (quiet[x] + step)
        slow[x] = follow * free if before else follow
        fresh[x] = settled & (not before)


@jit
def follow_row(
    picture: Array,
    ground: Array,
    deviation: Array,
    limits: tuple[float, float, float],
    pace: Array,
    slow: Array,
    fresh: Array,
) -> None:
    """The ground and its noise follow one color of one row.

    Loops are made of vector instructions only as no array overlaps one that is written to.
    """
    kind = ground.dtype.type
    least, most, usual = kind(limits[0]), kind(limits[1]), kind(limits[2])
    for x in range(ground.shape[0]):
        before, own = ground[x], deviation[x]
        difference = picture[x] - before
        own = own + slow[x] * (min(abs(difference), most * max(least, own)) - own)
        deviation[x] = min(own, least * usual) if fresh[x] > 0 else own
        ground[x] = before + pace[x] * difference
