"""What kernels do with the rows that navigation reads: grey of both eyes, and the high-pass of ND-min."""

from __future__ import annotations

from typing import Any

import numpy as np

from ndtorch.kernels.grey import grey_row
from ndtorch.utils.jit import jit

Array = Any
"""A NumPy array, or one row of it."""


@jit
def grey_rows(
    frames: tuple[Array, Array],
    beside: bool,
    tops: tuple[int, int],
    lefts: tuple[int, int],
    every: int,
    unit: float,
    count: int,
    grey: Array,
) -> None:
    """Rows of both eyes, see `grey_row`: `[2, h, w]`."""
    for eye in range(2):
        for y in range(grey.shape[1]):
            grey_row(frames[eye], beside, tops[eye] + y, lefts[eye], every, unit, count, grey[eye, y])


@jit
def high_pass(grey: Array, low: Array, start: Any, settle: bool, a: float, after: Array, whole: Array) -> None:
    """One step of `NDMin` of some pixels in a row.

    Args:
        grey, low: pixels and state, `[n]`.
        start: where the row begins in them.
        settle: it starts at rest.
        after: becomes the new state there.
        whole: of every column, becomes the magnitude of the output, or stays what it is where that is larger.
    """
    kind = grey.dtype.type
    if settle:
        for x in range(whole.shape[0]):
            after[start + np.uintp(x)] = grey[start + np.uintp(x)]
            whole[x] = larger(abs(grey[start + np.uintp(x)] - grey[start + np.uintp(x)]), whole[x])
        return
    # As `torch.lerp` rounds it: from the nearer end. A loop for each is made of vector instructions.
    if kind(a) < kind(0.5):
        toward(low, grey, kind(a), grey, start, after, whole)
    else:
        toward(grey, low, kind(1 - a), grey, start, after, whole)


@jit
def toward(one: Array, other: Array, share: float, grey: Array, start: Any, after: Array, whole: Array) -> None:
    """Means between two rows, and how far from them a third is, where that is farther than before."""
    for x in range(whole.shape[0]):
        k = start + np.uintp(x)
        mean = one[k] + share * (other[k] - one[k])
        after[k] = mean
        whole[x] = larger(abs(grey[k] - mean), whole[x])


@jit(exact=True)
def larger(one: float, other: float) -> float:
    """The larger of two; what is no number is larger than all."""
    return one if one > other or one != one else other
