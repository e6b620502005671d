"""One pass in which the ground and its noise follow the picture."""

from __future__ import annotations

from ndtorch.kernels.filters import Array


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
    kind = picture.dtype.type
    step, share, follow = kind(dt), kind(a_ground), kind(a_noise)
    held, most, one = kind(1 - hold), kind(surprise), kind(1)
    for y in range(picture.shape[1]):
        for x in range(picture.shape[2]):
            free = one - held * kept[y, x]
            before = known[y, x] > 0
            settled = before | (quiet[y, x] >= needed)
            new_known[y, x] = settled
            pace = share * free if before else step / (quiet[y, x] + step)
            slow = follow * free if before else follow
            fresh = settled & (not before)
            for c in range(3):
                difference = picture[c, y, x] - ground[c, y, x]
                size, own, least = abs(difference), deviation[c, y, x], noise[c]
                limited = min(size, most * max(least, own))
                own = own + slow * (limited - own)
                new_deviation[c, y, x] = min(own, least * kind(mean_size)) if fresh else own
                new_ground[c, y, x] = ground[c, y, x] + pace * difference
