"""Order statistics of a few thousand numbers, for compiled functions."""

from __future__ import annotations

from typing import Any

from ndtorch.utils.jit import jit

Array = Any
FEW = 12
"""Ranges of up to this many values are sorted by insertion."""


@jit
def median(values: Array, count: int) -> float:
    """The median of the first `count` values, which stay as they are; NaN is not allowed."""
    half = count // 2
    some = values[:count].copy()
    partial_sort(some, count, half)
    if count % 2:
        return float(some[half])
    before = some[0]
    for k in range(half):
        before = max(before, some[k])
    return float((before + some[half]) / values.dtype.type(2))


@jit
def partial_sort(some: Array, count: int, n: int) -> None:
    """Put value n of the order at its place and no larger value before it."""
    low, high = 0, count
    while high - low > FEW:
        step = (high - low) // 8
        one, other, third = some[low + step], some[low + 4 * step], some[low + 7 * step]
        pivot = max(min(one, other), min(max(one, other), third))
        # Values below the pivot go to the front; if there are none, those equal to it. There is no branch to predict.
        for equal in range(2):
            at = low
            for k in range(low, high):
                value = some[k]
                some[k] = some[at]
                some[at] = value
                at += (value < pivot) | ((equal == 1) & (value == pivot))
            if at > low:
                break
        # All of these are equal, or one is NaN.
        if (n < at and equal) or at == low:
            return
        low, high = (low, at) if n < at else (at, high)
    for k in range(low + 1, high):
        value, m = some[k], k
        while m > low and some[m - 1] > value:
            some[m] = some[m - 1]
            m -= 1
        some[m] = value
