"""Margins in which a picture goes on mirrored at the middle of its outer pixels."""

from __future__ import annotations

from ndtorch.kernels.filters import Array
from ndtorch.utils.jit import jit


@jit
def mirrored(images: Array, top: int, left: int, padded: Array) -> None:
    """What `torch.nn.functional.pad` does with `mode="reflect"`.

    Args:
        images: `[n, h, w]`.
        top, left: rows above and below, and columns on both sides, fewer than the picture has.
        padded: becomes the pictures with their margins, `[n, h + 2 top, w + 2 left]`.
    """
    count, height, width = images.shape
    for n in range(count):
        for y in range(height + 2 * top):
            at = abs(y - top)
            row, line = images[n, min(at, 2 * height - 2 - at)], padded[n, y]
            line[left : left + width] = row
            for x in range(left):
                line[x] = row[left - x]
                line[left + width + x] = row[width - 2 - x]
