"""How much a picture changes at every pixel, and for how long nothing has moved there."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.inner import apart
from ndtorch.kernels.most_of import mark_most
from ndtorch.kernels.nth import few_of, middle_of


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
    after: Array,
    still: Array,
) -> float:
    """See `ndtorch.vision.camera.figures.stillness`.

    Args:
        picture, before: blurred, `[3, h, w]`.
        own: mean change from picture to picture, `[h, w]`.
        quiet: seconds without motion, and known: where the ground is, `[h, w]`.
        out: 1 where something stands out, `[h, w]` uint8.
        dt: seconds of a step.
        side: of the square in which most must have moved.
        block, other: side of a block, and difference of its mean from that before which makes it another.
        moved, spread, follow, surprise: constants.
        sizes: mean magnitude of a normal variable against its deviation, and median of its magnitude likewise.
        after: becomes the mean change, `[h, w]`.
        still: becomes the seconds without motion, `[h, w]`.

    Returns:
        The share of the blocks that are others, -1 where the picture has no whole number of blocks.
    """
    _, height, width = picture.shape
    kind = picture.dtype.type
    change, others = np.empty((height, width), picture.dtype), 0
    across, whole = width // block, height % block == 0 and width % block == 0
    sums, least_sum = np.zeros((3, width), picture.dtype), kind(other * block * block)
    third, usual = kind(1 / 3), kind(1 / sizes[0])
    for y in range(height):
        add_change(picture[0, y], before[0, y], change[y], True)
        add_change(picture[1, y], before[1, y], change[y], False)
        add_change(picture[2, y], before[2, y], change[y], False)
        for x in range(width):
            change[y, x] *= third
        if not whole:
            continue
        for c in range(3):
            add_difference(picture[c, y], before[c, y], sums[c])
        if y % block == block - 1:
            for n in range(across):
                most = kind(0)
                for c in range(3):
                    most = max(most, abs(sums[c, n * block : (n + 1) * block].sum()))
                others += most > least_sum
            sums[:] = 0
    some = few_of(change)
    noise = kind(middle_of(some, some.shape[0]) / kind(sizes[1]))
    over, unknown = np.empty((height, width), np.uint8), 0
    limits = (noise, kind(moved), kind(spread), kind(surprise), kind(follow), usual)
    for y in range(height):
        unknown += judge(change[y], own[y], known[y], limits, over[y], after[y])
    moves = np.zeros((height + 2, width + 2), np.uint8)
    mark_most(over, side, moves[1:-1, 1:-1])
    if unknown:
        stands = np.zeros((height, width), np.uint8)
        mark_most(out, side, stands)
        for y in range(height):
            for x in range(width):
                moves[y + 1, x + 1] |= stands[y, x] & (known[y, x] == 0)
    near = np.empty(width + 2, np.uint8)
    for y in range(height):
        upper, middle, lower = moves[y], moves[y + 1], moves[y + 2]
        join(upper, middle, lower, near)
        wait(near, quiet[y], kind(dt), still[y])
    return others / (height // block * across) if whole else -1.0


@apart
def add_change(picture: Array, before: Array, change: Array, first: bool) -> None:
    """Add how much one color of a row has changed; the first one starts anew."""
    none = change.dtype.type(0)
    for x in range(change.shape[0]):
        change[x] = (none if first else change[x]) + abs(picture[x] - before[x])


@apart
def add_difference(picture: Array, before: Array, sums: Array) -> None:
    """Add what one color of a row has gained."""
    for x in range(sums.shape[0]):
        sums[x] += picture[x] - before[x]


@apart
def judge(
    change: Array,
    own: Array,
    known: Array,
    limits: tuple[float, float, float, float, float, float],
    over: Array,
    after: Array,
) -> int:
    """Mark what changes by more than noise in a row, and learn that; of how many pixels the ground is not known."""
    noise, moved, spread, surprise, follow, usual = limits
    unknown = np.int32(0)
    for x in range(after.shape[0]):
        here, usually = change[x], own[x]
        least = max(noise, usually * usual)
        over[x] = here > max(moved, spread * least)
        after[x] = usually + follow * (min(here, surprise * least) - usually)
        unknown += np.int32(known[x] == 0)
    return int(unknown)


@apart
def join(upper: Array, middle: Array, lower: Array, near: Array) -> None:
    """Marks of three rows."""
    for x in range(near.shape[0]):
        near[x] = upper[x] | middle[x] | lower[x]


@apart
def wait(near: Array, quiet: Array, dt: float, still: Array) -> None:
    """Seconds without motion go on where no neighbour is marked, and begin anew elsewhere."""
    none = still.dtype.type(0)
    for x in range(still.shape[0]):
        still[x] = none if near[x] | near[x + 1] | near[x + 2] else quiet[x] + dt
