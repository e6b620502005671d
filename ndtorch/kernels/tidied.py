"""What stands out, made into a figure: without shadows, gaps and specks, in one call."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.most_of import mark_most
from ndtorch.kernels.widened import closed, copied, opened, row_of
from ndtorch.kernels.without_shadow import without_shadow
from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array

leave_shadows_out = without_shadow


@jit
def tidied(
    out: Array,
    known: Array,
    quiet: Array,
    light: Array,
    may_be: Array,
    pale: Array,
    shadow: tuple[int, int, float, float],
    sides: tuple[int, int, int, int],
    trail: float,
    figure: Array,
    narrow: Array,
) -> None:
    """See `ndtorch.vision.camera.figures.tidied`.

    Args:
        out: 1 where a pixel stands out, `[h, w]` uint8; it becomes 0 where no ground is known.
        known: where that is, and quiet: seconds without motion, `[h, w]`.
        light: over that of the ground, `[h, w]`.
        may_be, pale: 1 where shadow may be, and where so with hardly any tint, `[h, w]` uint8.
        shadow: side, edge, darkest and uneven of `without_shadow`.
        sides: of the gaps that are closed, of what is broad where no ground is known, of specks, and of what is too
            broad to be a narrow shadow; 0 where none is looked for, and `pale` is all zero.
        trail: seconds.
        figure: becomes 1 where a figure is, `[h, w]` uint8.
        narrow: becomes 1 where a narrow shadow may be on known ground, likewise.
    """
    height, width = out.shape
    shape, margin = (height, width), max(max(sides[0], sides[1]), max(sides[2], sides[3]))
    size = (height + 2 * margin) * (width + 2 * margin)
    marks, room = np.zeros(size, np.uint8), (np.empty(size, np.uint8), np.empty(size, np.uint8))
    dark = young = 0
    for y in range(height):
        dark |= on_known(out[y], known[y], pale[y], narrow[y])
    leave_shadows_out(out, light, may_be, shadow[0], shadow[1], shadow[2], shadow[3], figure)
    # A dark coat looks like a shadow, but the rest of its wearer is around it.
    for y in range(height):
        copied(figure[y], row_of(marks, y, width, margin))
    closed(marks, sides[0], shape, margin, room)
    for y in range(height):
        common(row_of(marks, y, width, margin), out[y], figure[y])
    # What moves where no ground is known is believed where it is broad: edges of what stands still tremble.
    for y in range(height):
        young |= mark_young(quiet[y], known[y], trail, row_of(marks, y, width, margin))
    if young:
        opened(marks, sides[1], shape, margin, room)
        for y in range(height):
            add(row_of(marks, y, width, margin), figure[y])
    # A pixel alone is noise; a gap of a pixel is none.
    most = np.empty((height, width), np.uint8)
    mark_most(figure, sides[2], most)
    for y in range(height):
        copied(most[y], row_of(marks, y, width, margin))
    opened(marks, sides[2], shape, margin, room)
    for y in range(height):
        copied(row_of(marks, y, width, margin), figure[y])
    if sides[3] and dark:
        opened(marks, sides[3], shape, margin, room)
        for y in range(height):
            leave_out(row_of(marks, y, width, margin), narrow[y])


@jit
def on_known(out: Array, known: Array, pale: Array, narrow: Array) -> int:
    """Leave out what stands out in a row where no ground is known; whether a narrow shadow may be in it."""
    dark = np.uint8(0)
    for x in range(out.shape[0]):
        sure = np.uint8(known[x] > 0)
        out[x] &= sure
        narrow[x] = pale[x] & sure
        dark |= narrow[x]
    return int(dark)


@jit
def common(marks: Array, out: Array, figure: Array) -> None:
    """What is marked and stands out."""
    for x in range(figure.shape[0]):
        figure[x] = marks[x] & out[x]


@jit
def mark_young(quiet: Array, known: Array, trail: float, marks: Array) -> int:
    """Mark what moved lately where no ground is known; whether anything did."""
    lately, young = quiet.dtype.type(trail), np.uint8(0)
    for x in range(marks.shape[0]):
        marks[x] = (quiet[x] < lately) & (known[x] <= 0)
        young |= marks[x]
    return int(young)


@jit
def add(marks: Array, figure: Array) -> None:
    """Add marks to others."""
    for x in range(figure.shape[0]):
        figure[x] |= marks[x]


@jit
def leave_out(marks: Array, narrow: Array) -> None:
    """Take away what is marked."""
    for x in range(narrow.shape[0]):
        narrow[x] &= ~marks[x]
