"""What kernels do with the rows that navigation reads: grey of both eyes, and the high-pass of ND-min."""

from __future__ import annotations

from typing import Any

import numba
import numba.extending
import numpy as np

from ndtorch.kernels.grey import grey_row
from ndtorch.kernels.inner import apart, exactly, inner

Array = Any
"""A NumPy array, or one row of it."""


@inner
def grey_rows(
    frames: tuple[Array, Array],
    beside: bool,
    tops: tuple[int, int],
    lefts: tuple[int, int],
    every: int,
    unit: float,
    count: int,
    grey: Array,
) -> None:
    """Rows of both eyes, see `grey_row`: `[2, h, w]`."""
    for eye in range(2):
        for y in range(grey.shape[1]):
            grey_row(frames[eye], beside, tops[eye] + y, lefts[eye], every, unit, count, grey[eye, y])


@inner
def high_pass(grey: Array, low: Array, start: Any, settle: bool, a: float, after: Array, whole: Array) -> None:
    """One step of `NDMin` of some pixels in a row.

    Args:
        grey, low: pixels and state, `[n]`.
        start: where the row begins in them.
        settle: it starts at rest.
        after: becomes the new state there.
        whole: of every column, becomes the magnitude of the output, or stays what it is where that is larger; in
            numbers `as_whole`.
    """
    kind = grey.dtype.type
    if settle:
        for x in range(whole.shape[0]):
            after[start + np.uintp(x)] = grey[start + np.uintp(x)]
            whole[x] = max(whole[x], bits_of(abs(grey[start + np.uintp(x)] - grey[start + np.uintp(x)])))
        return
    # As `torch.lerp` rounds it: from the nearer end. A loop for each is made of vector instructions.
    if kind(a) < kind(0.5):
        toward(low, grey, kind(a), grey, start, after, whole)
    else:
        toward(grey, low, kind(1 - a), grey, start, after, whole)


@apart
def toward(one: Array, other: Array, share: float, grey: Array, start: Any, after: Array, whole: Array) -> None:
    """Means between two rows, and how far from them a third is, where that is farther than before."""
    for x in range(whole.shape[0]):
        k = start + np.uintp(x)
        mean = one[k] + share * (other[k] - one[k])
        after[k] = mean
        whole[x] = max(whole[x], bits_of(abs(grey[k] - mean)))


def as_whole(size: Array) -> Array:
    """Magnitudes as whole numbers of the same order, in which what is no number is larger than all.

    Unlike those of floating point numbers, loops over their maxima become vector instructions.
    """
    return size.view(np.int32 if size.itemsize == 4 else np.int64)


def view_of_whole(typing: Any, size: Any) -> Any:
    """The array with another type; `size.view` does the same, but compiling it takes most of a second."""
    whole = size.copy(dtype=numba.types.Integer.from_bitwidth(size.dtype.bitwidth))

    def make(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        before = context.make_array(size)(context, builder, given[0])
        after = context.make_array(whole)(context, builder)
        for part in ("meminfo", "parent", "nitems", "itemsize", "shape", "strides"):
            setattr(after, part, getattr(before, part))
        after.data = builder.bitcast(before.data, after.data.type)
        out = after._getvalue()
        context.nrt.incref(builder, whole, out)
        return out

    return whole(size), make


def number_as_whole(typing: Any, number: Any) -> Any:
    """`as_whole` of a single number."""
    whole = numba.types.Integer.from_bitwidth(number.bitwidth)

    def make(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        return builder.bitcast(given[0], context.get_value_type(whole))

    return whole(number), make


seen_as_whole: Any = numba.extending.intrinsic(view_of_whole)
bits_of: Any = numba.extending.intrinsic(number_as_whole)


@numba.extending.overload(as_whole, strict=False)
def compiled_as_whole(size: Any) -> Any:
    """`as_whole` in kernels, where types are known before."""
    return lambda size: seen_as_whole(size)


@exactly
def larger(one: float, other: float) -> float:
    """The larger of two; what is no number is larger than all."""
    return one if one > other or one != one else other
