"""Whether anything is in a row: most rows hold nothing, and need not be looked at number by number."""

from __future__ import annotations

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def any_of(row: Array) -> bool:
    """Whether one of some whole numbers is not 0."""
    some = np.int32(0)
    for x in range(row.shape[0]):
        some |= np.int32(row[x])
    return bool(some != 0)
