"""How much a picture changes at every pixel, and for how long nothing has moved there."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.most_of import mark_most
from ndtorch.kernels.nth import few_of, middle_of
from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def restless(
    picture: Array,
    before: Array,
    own: Array,
    quiet: Array,
    known: Array,
    out: Array,
    dt: float,
    side: int,
    block: int,
    other: float,
    moved: float,
    spread: float,
    sizes: tuple[float, float],
    follow: float,
    surprise: float,
) -> float:
    """See `ndtorch.vision.camera.figures.stillness`.

    Args:
        picture, before: blurred, `[3, h, w]`.
        own: mean change from picture to picture, and quiet: seconds without motion, `[h, w]`; they become those after
            the step.
        known: where the ground is, `[h, w]`.
        out: 1 where something stands out, `[h, w]` uint8.
        dt: seconds of a step.
        side: of the square in which most must have moved.
        block, other: side of a block, and difference of its mean from that before which makes it another.
        moved, spread, follow, surprise: constants.
        sizes: mean magnitude of a normal variable against its deviation, and median of its magnitude likewise.

    Returns:
        The share of the blocks that are others, -1 where the picture has no whole number of blocks.
    """
    _, height, width = picture.shape
    kind = picture.dtype.type
    change, others = np.empty((height, width), picture.dtype), 0
    across, whole = width // block, height % block == 0 and width % block == 0
    red, green, blue = np.zeros(width, kind), np.zeros(width, kind), np.zeros(width, kind)
    least_sum, third, usual = kind(other * block * block), kind(1 / 3), kind(1 / sizes[0])
    for y in range(height):
        now, then = (picture[0, y], picture[1, y], picture[2, y]), (before[0, y], before[1, y], before[2, y])
        add_changes(now[0], now[1], now[2], then[0], then[1], then[2], third, change[y], red, green, blue)
        if whole and y % block == block - 1:
            for n in range(across):
                others += max(sum_of(red, n, block), sum_of(green, n, block), sum_of(blue, n, block)) > least_sum
    some = few_of(change)
    noise = kind(middle_of(some, some.shape[0]) / kind(sizes[1]))
    over, unknown = np.empty((height, width), np.uint8), 0
    limits = (noise, kind(moved), kind(spread), kind(surprise), kind(follow), usual)
    for y in range(height):
        unknown += judge(change[y], own[y], known[y], limits, over[y])
    moves = np.empty((height, width), np.uint8)
    mark_most(over, side, moves)
    if unknown:
        mark_most(out, side, over)
        for y in range(height):
            add_unknown(over[y], known[y], moves[y])
    near = np.zeros(width + 2, np.uint8)
    for y in range(height):
        join(moves[max(y - 1, 0)], moves[y], moves[min(y + 1, height - 1)], near)
        wait(near, kind(dt), quiet[y])
    return others / (height // block * across) if whole else -1.0


@jit
def add_changes(
    red: Array,
    green: Array,
    blue: Array,
    old_red: Array,
    old_green: Array,
    old_blue: Array,
    third: float,
    change: Array,
    red_sums: Array,
    green_sums: Array,
    blue_sums: Array,
) -> None:
    """How much a row has changed in the mean of its colors, and what each has gained, which is added to sums."""
    for x in range(change.shape[0]):
        r, g, b = red[x] - old_red[x], green[x] - old_green[x], blue[x] - old_blue[x]
        change[x] = (abs(r) + abs(g) + abs(b)) * third
        red_sums[x] += r
        green_sums[x] += g
        blue_sums[x] += b


@jit
def sum_of(sums: Array, n: int, block: int) -> float:
    """Magnitude of the sum over one block, after which it begins anew."""
    total = sums.dtype.type(0)
    for x in range(n * block, (n + 1) * block):
        total += sums[x]
        sums[x] = 0
    return float(abs(total))


@jit
def judge(
    change: Array,
    own: Array,
    known: Array,
    limits: tuple[float, float, float, float, float, float],
    over: Array,
) -> int:
    """Mark what changes by more than noise in a row, and learn that; of how many pixels the ground is not known."""
    noise, moved, spread, surprise, follow, usual = limits
    unknown = np.int32(0)
    for x in range(over.shape[0]):
        here, usually = change[x], own[x]
        least = max(noise, usually * usual)
        over[x] = here > max(moved, spread * least)
        own[x] = usually + follow * (min(here, surprise * least) - usually)
        unknown += np.int32(known[x] == 0)
    return int(unknown)


@jit
def add_unknown(stands: Array, known: Array, moves: Array) -> None:
    """Add marks to others where the ground is not known."""
    for x in range(moves.shape[0]):
        moves[x] |= stands[x] & np.uint8(known[x] == 0)


@jit
def join(upper: Array, middle: Array, lower: Array, near: Array) -> None:
    """Marks of three rows, from the second number on. At an edge two of them are one."""
    for x in range(middle.shape[0]):
        near[x + 1] = upper[x] | middle[x] | lower[x]


@jit
def wait(near: Array, dt: float, quiet: Array) -> None:
    """Seconds without motion go on where no neighbour is marked, and begin anew elsewhere."""
    none = quiet.dtype.type(0)
    for x in range(quiet.shape[0]):
        quiet[x] = none if near[x] | near[x + 1] | near[x + 2] else quiet[x] + dt
