"""The ten signals of silhouettes from what was summed over each, and from their oriented responses."""

from __future__ import annotations

from math import sqrt

import numpy as np

from ndtorch.kernels.any_of import any_of
from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def field_signals(images: Array, silhouettes: Array, sums: Array, signals: Array) -> None:
    """The last part of `FigureSignals.forward`.

    Args:
        images: responses at three orientations, `[3, h / 2, w / 2]`.
        silhouettes: `[h, w]` int32.
        sums: of `field_sums`, `[fields, 6]`.
        signals: become the ten of each field, `[fields, 10]`.
    """
    _, height, width = images.shape
    fields = sums.shape[0]
    tilted = np.zeros((fields, 3))
    for y in range(height):
        some = any_of(silhouettes[2 * y]) or any_of(silhouettes[2 * y + 1])
        for x in range(width if some else 0):
            top = max(silhouettes[2 * y, 2 * x], silhouettes[2 * y, 2 * x + 1])
            name = max(top, max(silhouettes[2 * y + 1, 2 * x], silhouettes[2 * y + 1, 2 * x + 1]))
            if name > 0:
                n = (name - 1) % fields
                for k in range(3):
                    tilted[n, k] += abs(images[k, y, x])
    for n in range(fields):
        pixels = max(sums[n, 0], 1.0)
        across, along = sums[n, 1] / pixels, sums[n, 2] / pixels
        signals[n, 0], signals[n, 1] = sqrt(max(-across, 0.0)), sqrt(max(across, 0.0))
        signals[n, 2], signals[n, 3] = sqrt(max(along, 0.0)), sqrt(max(-along, 0.0))
        least = min(tilted[n, 0], tilted[n, 1], tilted[n, 2])
        for k in range(3):
            signals[n, 4 + k] = sqrt((tilted[n, k] - least) / pixels)
            signals[n, 7 + k] = sqrt(sums[n, 3 + k] / pixels)
