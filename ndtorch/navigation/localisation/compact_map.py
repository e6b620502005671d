"""An NDT map in six bytes a cell, for the way home: what a localiser needs that maps no more.

A cell of `ndt` becomes its column and row, its mean within the cell, and its ellipse: one standard deviation along and
one across, each on a logarithmic scale of 16 steps, and the direction. The weight is not kept.
"""

from __future__ import annotations

import math
import zlib

import numpy as np

from ndtorch.navigation.localisation._kernels import MIN_WEIGHT, Cells
from ndtorch.navigation.localisation.ndt import distributions, from_sparse

SMALLEST_M, STEP = 0.005, 1.25
"""Standard deviation of step 0, m, and the ratio of two steps: the last one is 14 cm."""


def compact_map(ndt_map: Cells, cell_m: float, home: tuple[float, float], most: int | None = None) -> bytes:
    """The cells of a map `[size, size, 6]` that have enough weight, packed and compressed.

    Args:
        cell_m: side of a cell, m.
        home: x and y, m.
        most: this number of cells is kept, those nearest to home; None keeps all.
    """
    mean, covariance = distributions(ndt_map, cell_m)
    nearest = np.argsort(np.hypot(*(mean - home).T), kind="stable")[:most]
    mean, covariance = mean[nearest], covariance[nearest]
    at = np.floor(mean / cell_m).clip(-128, 127)
    value, axes = np.linalg.eigh(covariance)
    level = np.log(np.sqrt(value.clip(SMALLEST_M**2)) / SMALLEST_M) / math.log(STEP)
    across, along = np.rint(level).clip(0, 15).astype(np.uint8).T
    turned = np.arctan2(axes[:, 1, 1], axes[:, 0, 1]) % math.pi
    columns = (
        *(at + 128).T,
        *np.rint((mean / cell_m - at) * 255).clip(0, 255).T,
        along * 16 + across,
        np.floor(turned / math.pi * 256).clip(0, 255),
    )
    return zlib.compress(np.stack(columns).astype(np.uint8).tobytes(), 9)


def expand_map(packed: bytes, size: int, cell_m: float) -> Cells:
    """The map `[size, size, 6]` of what `compact_map` packed; all its cells have the least weight that counts."""
    part = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(6, -1).astype(np.float64)
    at, mean = part[:2] - 128, (part[2:4] / 255 - 0.5) * cell_m
    along, across = (SMALLEST_M * STEP**level for level in np.divmod(part[4], 16))
    turned = (part[5] + 0.5) * math.pi / 256
    cos, sin = np.cos(turned), np.sin(turned)
    xx, yy = (along * cos) ** 2 + (across * sin) ** 2, (along * sin) ** 2 + (across * cos) ** 2
    xy = (along**2 - across**2) * cos * sin
    square = np.stack((xx + mean[0] ** 2, xy + mean[0] * mean[1], yy + mean[1] ** 2))
    ones = np.ones((1, part.shape[1]))
    return from_sparse(np.concatenate((at, MIN_WEIGHT * np.concatenate((ones, mean, square)))).T, size)
