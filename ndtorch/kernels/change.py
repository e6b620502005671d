"""How much one picture differs from another, whatever the light does to all of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[Any]


@jit
def change(now: Floats, before: Floats) -> float:
    """Standard deviation of the difference of two rows of numbers, `[n]` each, n > 0."""
    count = len(now)
    steps, total, square = np.empty(count, now.dtype), 0.0, 0.0
    for x in range(count):
        steps[x] = now[x] - before[x]
        total += steps[x]
    total /= count
    for x in range(count):
        square += (steps[x] - total) ** 2
    return math.sqrt(square / count)
