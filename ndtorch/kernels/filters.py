"""What kernels do with one row of pixels: grey, the filters of the motion detectors, correlation of neighbours."""

from __future__ import annotations

from typing import Any

import numba

from ndtorch.kernels.load import FAST

Array = Any
"""A NumPy array, or one row of it."""


@numba.njit(fastmath=FAST, error_model="numpy")
def grey_planes(red: Array, green: Array, blue: Array, third: float, image: Array) -> tuple[float, float, float]:
    """Mean of three colors into `image`, and the sum of each; `third` scales to 0..1 as well."""
    kind = image.dtype.type
    r, g, b = kind(0), kind(0), kind(0)
    for x in range(image.shape[0]):
        one, two, three = kind(red[x]), kind(green[x]), kind(blue[x])
        image[x] = (one + two + three) * third
        r, g, b = r + one, g + two, b + three
    return r, g, b


@numba.njit(fastmath=FAST, error_model="numpy")
def grey_pixels(pixels: Array, third: float, image: Array) -> tuple[float, float, float]:
    """As `grey_planes` of pixels `[W, 3]`, whose colors lie side by side in memory."""
    kind = image.dtype.type
    r, g, b = kind(0), kind(0), kind(0)
    for x in range(image.shape[0]):
        one, two, three = kind(pixels[x, 0]), kind(pixels[x, 1]), kind(pixels[x, 2])
        image[x] = (one + two + three) * third
        r, g, b = r + one, g + two, b + three
    return r, g, b


@numba.njit(fastmath=FAST, error_model="numpy")
def filter_row(
    image: Array, slow: Array, delayed: Array, a_high: float, a_low: float, low: Array, high: Array, late: Array
) -> None:
    """`motion_step` of one row: new states into `low` and `late`, the high-passed row into `high`.

    Numbers that have died away become zero: as denormals they would make every later frame ten times slower.
    """
    kind = image.dtype.type
    tiny = kind(1e-30)
    for x in range(image.shape[0]):
        mean = slow[x] + a_high * (image[x] - slow[x])
        fast = image[x] - mean
        after = delayed[x] + a_low * (fast - delayed[x])
        low[x] = mean if abs(mean) > tiny else kind(0)
        high[x] = fast
        late[x] = after if abs(after) > tiny else kind(0)


@numba.njit(fastmath=FAST, error_model="numpy")
def correlate(high: Array, late: Array, high_before: Array, late_before: Array) -> tuple[float, float]:
    """Sum and sum of magnitudes of `high late_before - high_before late`."""
    kind = high.dtype.type
    total, size = kind(0), kind(0)
    for x in range(high.shape[0]):
        signed = high[x] * late_before[x] - high_before[x] * late[x]
        total += signed
        size += abs(signed)
    return total, size


@numba.njit(fastmath=FAST, error_model="numpy")
def add_weighted(row: Array, weight: float, total: Array) -> None:
    """`total += weight row`."""
    for x in range(row.shape[0]):
        total[x] += weight * row[x]
