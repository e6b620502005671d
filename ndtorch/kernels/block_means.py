"""A frame averaged over blocks, in one pass over its pixels."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array


def block_means(lines: Array, beside: int, unit: float, means: Array) -> None:
    """`torch.nn.functional.adaptive_avg_pool2d` of the three colors.

    Args:
        lines: the frame, `[3 / beside, H, W beside]`.
        beside: how many colors lie beside each other, 1 or 3.
        unit: factor that scales pixels to 0..1.
        means: becomes the averages, `[3, h, w]`.
    """
    planes, height, length = lines.shape
    _, rows, columns = means.shape
    width = length // beside
    kind = means.dtype.type
    line = np.empty(length, means.dtype)
    for plane in range(planes):
        for row in range(rows):
            top, bottom = row * height // rows, ((row + 1) * height + rows - 1) // rows
            line[:] = 0
            for y in range(top, bottom):
                for x in range(length):
                    line[x] += kind(lines[plane, y, x])
            for column in range(columns):
                left, right = column * width // columns, ((column + 1) * width + columns - 1) // columns
                scale = unit / ((bottom - top) * (right - left))
                for color in range(beside):
                    total = kind(0)
                    for x in range(left, right):
                        total += line[x * beside + color]
                    means[plane * beside + color, row, column] = total * scale
