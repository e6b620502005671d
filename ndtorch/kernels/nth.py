"""Medians of a few thousand numbers, and the pixels of a picture that they are taken from."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.inner import inner

FEW = 12
"""So few numbers are sorted one by one."""


@inner
def middle_of(values: Array, count: int) -> float:
    """The median of the first `count` values; `nth_of` says what becomes of them."""
    half = count // 2
    some = ordered_at(values, count, half)
    here = some[half]
    if count % 2:
        return float(here)
    before = some[0]
    for n in range(half):
        before = max(before, some[n])
    return float((before + here) / values.dtype.type(2))


@inner
def nth_of(values: Array, count: int, n: int) -> float:
    """The value that n of the first `count` values come before in order. Their order stays; NaN are not allowed."""
    return float(ordered_at(values, count, n)[n])


@inner
def ordered_at(values: Array, count: int, n: int) -> Array:
    """A copy of the first `count` values, with that one in place n, and none before it that is larger, `[count]`."""
    some = values[:count].copy()
    low, high = 0, count
    while high - low > FEW:
        step = (high - low) // 8
        one, other, third = some[low + step], some[low + 4 * step], some[low + 7 * step]
        pivot = max(min(one, other), min(max(one, other), third))
        # Those below it to the front, and where there are none, those that equal it. Without branches: which way they
        # go is not to be foretold.
        for equal in range(2):
            at = low
            for k in range(low, high):
                value = some[k]
                some[k] = some[at]
                some[at] = value
                at += (value < pivot) | ((equal == 1) & (value == pivot))
            if at > low:
                break
        # All of these are equal, or none is a number.
        if (n < at and equal) or at == low:
            return some
        low, high = (low, at) if n < at else (at, high)
    for k in range(low + 1, high):
        value, m = some[k], k
        while m > low and some[m - 1] > value:
            some[m] = some[m - 1]
            m -= 1
        some[m] = value
    return some


@inner
def few_of(image: Array) -> Array:
    """`some_of` one plane `[h, w]`, `[n]`."""
    height, width = image.shape
    down, across = ((height + 1) // 2 + 3) // 4, ((width + 1) // 2 + 3) // 4
    some, n = np.empty(4 * down * across, image.dtype), 0
    for y in range(0, (height + 1) // 2, 4):
        for x in range(0, (width + 1) // 2, 4):
            some[n], some[n + 1] = image[y, x], image[y, width - 1 - x]
            some[n + 2], some[n + 3] = image[height - 1 - y, x], image[height - 1 - y, width - 1 - x]
            n += 4
    return some
