"""Medians of a few thousand numbers, and the pixels of a picture that they are taken from."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array

FEW = 12
"""So few numbers are sorted one by one."""
SAMPLE, MARGIN, ROUNDS = 32, 4, 8
"""So many numbers tell about where a value is, up to so many places in their order; and how often that is narrowed."""


@jit
def middle_of(values: Array, count: int) -> float:
    """The median of the first `count` values. Their order stays; NaN are not allowed."""
    half = count // 2
    some, place = ordered_at(values, count, half)
    here = some[place]
    if count % 2:
        return float(here)
    before = some[0]
    for n in range(place):
        before = max(before, some[n])
    return float((before + here) / values.dtype.type(2))


@jit
def nth_of(values: Array, count: int, n: int) -> float:
    """The value that n of the first `count` values come before in order. Their order stays; NaN are not allowed."""
    some, place = ordered_at(values, count, n)
    return float(some[place])


@jit
def ordered_at(values: Array, count: int, n: int) -> tuple[Array, int]:
    """Some of the first `count` values, and which of them has n of all before it in order; none before it is larger.

    If n is not 0, the one before it in order is among them.
    """
    low, high, first = bounds_of(values, count, n)
    some, found = np.empty(count, values.dtype), 0
    for k in range(count):
        some[found] = values[k]
        found += (values[k] >= low) & (values[k] <= high)
    # There is no such value where some are no numbers.
    place = min(n - first, max(found - 1, 0))
    part(some, found, place)
    return some, place


@jit
def bounds_of(values: Array, count: int, n: int) -> tuple[float, float, int]:
    """Bounds that value n in order and the one before it lie between, with few others, and how many are below.

    How many are below a bound is counted many at a time, and sooner than they are put in order.
    """
    kind = values.dtype.type
    low, high, first, last = kind(-np.inf), kind(np.inf), 0, count
    if count < 8 * SAMPLE:
        return low, high, first
    some, step = np.empty(SAMPLE, values.dtype), count // SAMPLE
    for k in range(SAMPLE):
        some[k] = values[k * step + step // 2]
    in_order(some, 0, SAMPLE)
    at = n * SAMPLE // count
    for turn in range(2 * ROUNDS):
        if turn == 0:
            bound = some[max(0, at - MARGIN)]
        elif turn == 1:
            bound = some[min(SAMPLE - 1, at + MARGIN)]
        elif last - first <= FEW or not math.isfinite(high - low):
            break
        else:
            bound = low + (high - low) / kind(2)
        below = count_below(values[:count], bound)
        # The value before it is asked for, too.
        if below < n or below == 0 == n:
            low, first = max(low, bound), max(first, below)
        elif below > n:
            high, last = min(high, bound), min(last, below)
        else:
            break
    return low, high, first


@jit
def count_below(values: Array, bound: float) -> int:
    """How many values are below that."""
    count = np.int32(0)
    for k in range(values.shape[0]):
        count += np.int32(values[k] < bound)
    return int(count)


@jit
def part(some: Array, count: int, n: int) -> None:
    """Put the first `count` values in order as far as that takes value n to its place, and none before it is larger."""
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
            return
        low, high = (low, at) if n < at else (at, high)
    in_order(some, low, high)


@jit
def in_order(some: Array, low: int, high: int) -> None:
    """Sort the values from one place to another."""
    for k in range(low + 1, high):
        value, m = some[k], k
        while m > low and some[m - 1] > value:
            some[m] = some[m - 1]
            m -= 1
        some[m] = value


@jit
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
