"""Medians of a few thousand numbers, and the pixels of a picture that they are taken from."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.inner import inner


@inner
def middle_of(values: Array, count: int) -> float:
    """The median of the first `count` values, whose order is changed."""
    half = count // 2
    low, high = 0, count - 1
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if half <= j:
            high = j
        elif half >= i:
            low = i
        else:
            break
    if count % 2:
        return float(values[half])
    # All before it are no larger: the largest of them is the other one.
    below = values[0]
    for n in range(1, half):
        below = max(below, values[n])
    return float((below + values[half]) / values.dtype.type(2))


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
