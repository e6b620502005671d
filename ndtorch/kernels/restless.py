"""How much a picture changes at every pixel, and for how long nothing has moved there."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
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
        for x in range(width):
            red, green = abs(picture[0, y, x] - before[0, y, x]), abs(picture[1, y, x] - before[1, y, x])
            change[y, x] = (red + green + abs(picture[2, y, x] - before[2, y, x])) * third
        if not whole:
            continue
        for c in range(3):
            for x in range(width):
                sums[c, x] += picture[c, y, x] - before[c, y, x]
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
    for y in range(height):
        for x in range(width):
            here, usually = change[y, x], own[y, x]
            least = max(noise, usually * usual)
            over[y, x] = here > max(kind(moved), kind(spread) * least)
            after[y, x] = usually + kind(follow) * (min(here, kind(surprise) * least) - usually)
            unknown += known[y, x] == 0
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
        for x in range(width + 2):
            near[x] = upper[x] | middle[x] | lower[x]
        left, right = near[1 : width + 1], near[2 : width + 2]
        for x in range(width):
            still[y, x] = kind(0) if near[x] | left[x] | right[x] else quiet[y, x] + kind(dt)
    return others / (height // block * across) if whole else -1.0
