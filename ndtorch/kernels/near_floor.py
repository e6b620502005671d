"""What `ndtorch.navigation.near_floor.row_likeness` does in NumPy, for one horizon after the other."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[np.float32]


@jit
def near_floor(
    left: Floats,
    right: Floats,
    rows: npt.NDArray[np.int64],
    offsets: npt.NDArray[np.int64],
    places: tuple[int, int, int, int],
    numbers: tuple[float, float, float, float, float, float],
    narrowest: int,
    pixels: int,
) -> float:
    """The largest correlation; no further horizon is looked at when one is enough.

    Args:
        left, right: the subfields `[h, w]`.
        rows: of the image, that see the floor right ahead.
        offsets: rows by which the horizon lies higher.
        places: top and left of the left subfield, top and left of the right one, in the image.
        numbers: baseline over height of the cameras, horizon, middle column, how far beside counts over the baseline,
            the correlation that is enough, and the least standard deviation of the brightness.
        narrowest, pixels: fewer columns of a row, or pixels in all, are not compared.
    """
    top, ours, other_top, theirs = places
    per_row, horizon, middle, beside, enough, blank = numbers
    width, also = left.shape[1], right.shape[1]
    best = 0.0
    for k in range(len(offsets)):
        count, both, squares, others = 0, 0.0, 0.0, 0.0
        for row in rows:
            shift = round(per_row * (row - horizon + offsets[k]))
            # Columns of the left image whose partner lies in the right subfield, and right ahead of the car.
            begin, end = max(ours, theirs + shift), min(ours + width, theirs + shift + also)
            first = max(begin, math.ceil(middle + shift / 2 - beside * shift))
            last = min(end, math.floor(middle + shift / 2 + beside * shift) + 1)
            if last - first < narrowest:
                continue
            here = left[row - top, first - ours : last - ours]
            there = right[row - other_top, first - shift - theirs : last - shift - theirs]
            n, mean, mean_too = last - first, np.float32(here.mean()), np.float32(there.mean())
            count += n
            for c in range(n):
                a, b = here[c] - mean, there[c] - mean_too
                both, squares, others = both + a * b, squares + a * a, others + b * b
        if count < max(1, pixels) or min(squares, others) < count * blank**2:
            likeness = 0.0
        else:
            likeness = both / math.sqrt(squares * others)
        best = likeness if k == 0 else max(best, likeness)
        if best >= enough:
            break
    return best
