"""Grey of a row of pixels, from frames of any kind."""

from __future__ import annotations

from typing import Any

import numba
import numba.extending
import numpy as np
from llvmlite import ir
from numba import types

from ndtorch.kernels.inner import apart, inner

Array = Any

ONE, TWO = np.uintp(1), np.uintp(2)
LOW, BITS = np.uint16(255), np.uint16(8)
Place = Any
"""`np.uintp`: where a number lies in an array, counted from its first one."""


@inner
def grey_row(frame: Array, beside: bool, y: int, left: int, every: int, unit: float, count: int, grey: Array) -> None:
    """Every so many pixels of row `y` from column `left` on: sum of colors times `unit`, over `count`.

    Args:
        frame: `[C, H, W]`, or `[H, W, C]` where colors lie `beside` each other; without gaps.
    """
    if beside:
        _, width, colors = frame.shape
        step, plane = colors, 1
    else:
        colors, height, width = frame.shape
        step, plane = 1, height * width
    start, more = np.uintp((y * width + left) * step), np.uintp(plane)
    kind = grey.dtype.type
    # The last pixel is looked up together with the byte behind it.
    fits = colors == 3 and left + every * grey.shape[0] <= width
    if fits and in_steps(frame, beside, start, more, every, kind(unit), count, grey):
        return
    # One color stands for three.
    over = kind(count if colors > 1 else 3 * count)
    middle, last = np.uintp(colors // 2) * more, np.uintp(colors - 1) * more
    in_any(frame, start, np.uintp(every * step), middle, last, kind(unit), over, grey)


@apart
def in_any(
    frame: Array, start: Place, step: Place, middle: Place, last: Place, unit: float, over: float, grey: Array
) -> None:
    """Grey of pixels any number of places apart, whose other colors are so many places behind the first."""
    kind = grey.dtype.type
    for x in range(grey.shape[0]):
        k = start + step * np.uintp(x)
        grey[x] = (kind(at(frame, k)) + kind(at(frame, k + middle)) + kind(at(frame, k + last))) * unit / over


def in_steps(
    frame: Array, beside: bool, start: Place, more: Place, every: int, unit: float, count: int, grey: Array
) -> bool:
    """Grey of three colors by a loop whose step is known, so that it becomes vector instructions; False without one."""
    return False


@inner
def bytes_in_steps(
    frame: Array, beside: bool, start: Place, more: Place, every: int, unit: float, count: int, grey: Array
) -> bool:
    """`in_steps` of bytes, which are added as whole numbers: that is exact."""
    if count != 1 or every > 2:
        return False
    if beside and every == 1:
        beside_each(frame, start, unit, grey)
    elif beside:
        beside_other(frame, start, unit, grey)
    elif every == 1:
        planes_each(frame, start, more, unit, grey)
    else:
        planes_other(frame, start, more, unit, grey)
    return True


@inner
def floats_in_steps(
    frame: Array, beside: bool, start: Place, more: Place, every: int, unit: float, count: int, grey: Array
) -> bool:
    """`in_steps` of numbers in planes."""
    if beside or every > 2:
        return False
    if every == 1:
        floats_each(frame, start, more, unit, grey.dtype.type(count), grey)
    else:
        floats_other(frame, start, more, unit, grey.dtype.type(count), grey)
    return True


@numba.extending.overload(in_steps, strict=False)
def compiled_in_steps(
    frame: Any, beside: Any, start: Any, more: Any, every: Any, unit: Any, count: Any, grey: Any
) -> Any:
    """`in_steps` in kernels, where types are known before."""
    found = bytes_in_steps if frame.dtype == types.uint8 else floats_in_steps
    return lambda frame, beside, start, more, every, unit, count, grey: found(
        frame, beside, start, more, every, unit, count, grey
    )


@apart
def beside_each(frame: Array, start: Place, unit: float, grey: Array) -> None:
    """Bytes of all pixels, colors beside each other."""
    whole, kind = np.uint16, grey.dtype.type
    for x in range(grey.shape[0]):
        k = start + np.uintp(3 * x)
        total = whole(at(frame, k)) + whole(at(frame, k + ONE)) + whole(at(frame, k + TWO))
        grey[x] = kind(whole(total)) * unit


@apart
def beside_other(frame: Array, start: Place, unit: float, grey: Array) -> None:
    """Bytes of every other pixel, colors beside each other."""
    whole, kind = np.uint16, grey.dtype.type
    for x in range(grey.shape[0]):
        k = start + np.uintp(6 * x)
        two = two_bytes(frame, k)
        grey[x] = kind(whole((two & LOW) + (two >> BITS) + (two_bytes(frame, k + TWO) & LOW))) * unit


@apart
def planes_each(frame: Array, start: Place, more: Place, unit: float, grey: Array) -> None:
    """Bytes of all pixels, colors in planes."""
    whole, kind = np.uint16, grey.dtype.type
    for x in range(grey.shape[0]):
        k = start + np.uintp(x)
        total = whole(at(frame, k)) + whole(at(frame, k + more)) + whole(at(frame, k + more + more))
        grey[x] = kind(whole(total)) * unit


@apart
def planes_other(frame: Array, start: Place, more: Place, unit: float, grey: Array) -> None:
    """Bytes of every other pixel, colors in planes."""
    whole, kind = np.uint16, grey.dtype.type
    for x in range(grey.shape[0]):
        k = start + np.uintp(2 * x)
        total = (two_bytes(frame, k) & LOW) + (two_bytes(frame, k + more) & LOW)
        grey[x] = kind(whole(total + (two_bytes(frame, k + more + more) & LOW))) * unit


@apart
def floats_each(frame: Array, start: Place, more: Place, unit: float, count: float, grey: Array) -> None:
    """Numbers of all pixels, colors in planes."""
    kind = grey.dtype.type
    for x in range(grey.shape[0]):
        k = start + np.uintp(x)
        grey[x] = (kind(at(frame, k)) + kind(at(frame, k + more)) + kind(at(frame, k + more + more))) * unit / count


@apart
def floats_other(frame: Array, start: Place, more: Place, unit: float, count: float, grey: Array) -> None:
    """Numbers of every other pixel, colors in planes."""
    kind = grey.dtype.type
    for x in range(grey.shape[0]):
        k = start + np.uintp(2 * x)
        grey[x] = (kind(at(frame, k)) + kind(at(frame, k + more)) + kind(at(frame, k + more + more))) * unit / count


def number_of(typing: Any, frame: Any, place: Any) -> Any:
    """The number at a place of an array without gaps, whatever its shape."""

    def make(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        data = context.make_array(frame)(context, builder, given[0]).data
        return context.unpack_value(builder, frame.dtype, builder.gep(data, [given[1]]))

    return frame.dtype(frame, types.uintp), make


def bytes_of(typing: Any, frame: Any, place: Any) -> Any:
    """A byte and the one behind it as one number, of which the first is the lower half.

    Where every other byte is wanted, a loop over such numbers has no bytes to sort.
    """

    def make(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        data = context.make_array(frame)(context, builder, given[0]).data
        both = builder.bitcast(builder.gep(data, [given[1]]), ir.IntType(16).as_pointer())
        found = builder.load(both)
        found.align = 1
        return found

    return types.uint16(frame, types.uintp), make


at: Any = numba.extending.intrinsic(number_of)
two_bytes: Any = numba.extending.intrinsic(bytes_of)
