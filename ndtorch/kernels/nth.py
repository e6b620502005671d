"""Medians of a few thousand numbers, and the pixels of a picture that they are taken from."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.inner import inner

SLOTS = 64


@inner
def middle_of(values: Array, count: int) -> float:
    """The median of the first `count` values; `nth_of` says what becomes of them."""
    half = count // 2
    here = nth_of(values, count, half)
    if count % 2:
        return float(here)
    # The one before it is the same one, or the largest of those below.
    below, fewer = values.dtype.type(-np.inf), 0
    for n in range(count):
        if values[n] < here:
            below = max(below, values[n])
            fewer += 1
    before = below if fewer == half else here
    return float((before + here) / values.dtype.type(2))


@inner
def nth_of(values: Array, count: int, n: int) -> float:
    """The value that n of the first `count` values come before in order. Their order stays; NaN are not allowed."""
    low, high = values[0], values[0]
    for k in range(count):
        low, high = min(low, values[k]), max(high, values[k])
    some, left, before = values[:count].copy(), count, n
    # Into slots by size, and again within the slot in which it lies, until few are left.
    while left > 12 and low < high:
        slots = np.zeros(SLOTS, np.int32)
        scale = SLOTS / (float(high) - float(low))
        for k in range(left):
            slots[slot_of(some[k], low, scale)] += 1
        at = 0
        while before >= slots[at]:
            before -= slots[at]
            at += 1
        kept = 0
        least, most = high, low
        for k in range(left):
            value = some[k]
            if slot_of(value, low, scale) == at:
                some[kept] = value
                kept += 1
                least, most = min(least, value), max(most, value)
        low, high, left = least, most, kept
    for k in range(1, left):
        value, m = some[k], k
        while m > 0 and some[m - 1] > value:
            some[m] = some[m - 1]
            m -= 1
        some[m] = value
    return float(some[before])


@inner
def slot_of(value: float, low: float, scale: float) -> int:
    """The slot of a value."""
    return min(int((value - low) * scale), SLOTS - 1)


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
