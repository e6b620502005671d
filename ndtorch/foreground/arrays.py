"""Types of the arrays of foreground and tracking, and memory for them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

Array = Any
"""An array in a compiled function."""
Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
Bytes = npt.NDArray[np.uint8]
Labels = npt.NDArray[np.int32]
Numbers = npt.NDArray[np.float64]

ALIGNMENT = 64
"""Bytes of a cache line. Compiled loops take up to a third longer over memory that does not begin at one."""


def aligned(*shape: int) -> Floats:
    """Uninitialised memory for float32 numbers."""
    size = 4 * math.prod(shape)
    memory = np.empty(size + ALIGNMENT, np.uint8)
    first = -memory.ctypes.data % ALIGNMENT
    return memory[first : first + size].view(np.float32).reshape(shape)


def aligned_copy(values: Any) -> Floats:
    """A copy of an array or CPU tensor."""
    copy = aligned(*values.shape)
    copy[...] = values
    return copy
