"""Compiled: pixels of both cameras to grey, the high-pass of ND-min, and its largest output in each cell."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ndtorch.utils.jit import jit

Array = Any
"""A NumPy array."""


class Frames(NamedTuple):
    """One frame of each camera, and where in them the rectangles begin that are read.

    Attributes:
        left, right: uint8 or floating point, `[C, H, W]`, or `[H, W, C]` where colors are `interleaved`; contiguous.
        scale: grey is the sum of three colors times this; one color counts three times.
        tops, lefts: first row and column of the rectangle in the left and in the right frame.
    """

    left: Array
    right: Array
    interleaved: bool
    scale: float
    tops: tuple[int, int]
    lefts: tuple[int, int]


@jit
def grey_row(frame: Array, interleaved: bool, y: int, left: int, every: int, scale: float, grey: Array) -> None:
    """Grey of every so many pixels of row `y` from column `left` on, as many as `grey` `[n]` holds.

    Literal arguments would compile it anew: callers write `np.intp(0)`.
    """
    unit = np.float32(scale)
    quick = frame.itemsize == 1 and every <= 2
    if quick and not interleaved and frame.shape[0] == 3:
        if every == 1:
            grey_of_planes(frame, y, left, unit, grey)
        else:
            grey_of_other_planes(frame, y, left, unit, grey)
        return
    pixels = frame.reshape(-1)
    if interleaved:
        _, width, colors = frame.shape
        start, step, plane = (y * width + left) * colors, colors, 1
    else:
        colors, height, width = frame.shape
        start, step, plane = y * width + left, 1, height * width
    if quick and interleaved and colors == 3:
        if every == 1:
            grey_of_triples(pixels, start, unit, grey)
        else:
            grey_of_other_triples(pixels, start, unit, grey)
    else:
        grey_of_numbers(pixels, start, every * step, colors // 2 * plane, (colors - 1) * plane, unit, grey)


# Each loop has one literal step, so that it becomes vector instructions; bytes are added exactly as whole numbers.


@jit
def grey_of_triples(pixels: Array, start: int, unit: float, grey: Array) -> None:
    """All pixels, colors interleaved."""
    for x in range(grey.shape[0]):
        k = np.uintp(start) + np.uintp(3 * x)
        total = np.uint16(pixels[k]) + np.uint16(pixels[k + np.uintp(1)]) + np.uint16(pixels[k + np.uintp(2)])
        grey[np.uintp(x)] = np.float32(np.uint16(total)) * unit


@jit
def grey_of_other_triples(pixels: Array, start: int, unit: float, grey: Array) -> None:
    """Every other pixel, colors interleaved."""
    for x in range(grey.shape[0]):
        k = np.uintp(start) + np.uintp(6 * x)
        total = np.uint16(pixels[k]) + np.uint16(pixels[k + np.uintp(1)]) + np.uint16(pixels[k + np.uintp(2)])
        grey[np.uintp(x)] = np.float32(np.uint16(total)) * unit


@jit
def grey_of_planes(frame: Array, y: int, left: int, unit: float, grey: Array) -> None:
    """All pixels, colors in planes."""
    row, red, green, blue = np.uintp(y), np.uintp(0), np.uintp(1), np.uintp(2)
    for x in range(grey.shape[0]):
        k = np.uintp(left) + np.uintp(x)
        total = np.uint16(frame[red, row, k]) + np.uint16(frame[green, row, k]) + np.uint16(frame[blue, row, k])
        grey[np.uintp(x)] = np.float32(np.uint16(total)) * unit


@jit
def grey_of_other_planes(frame: Array, y: int, left: int, unit: float, grey: Array) -> None:
    """Every other pixel, colors in planes."""
    row, red, green, blue = np.uintp(y), np.uintp(0), np.uintp(1), np.uintp(2)
    for x in range(grey.shape[0]):
        k = np.uintp(left) + np.uintp(2 * x)
        total = np.uint16(frame[red, row, k]) + np.uint16(frame[green, row, k]) + np.uint16(frame[blue, row, k])
        grey[np.uintp(x)] = np.float32(np.uint16(total)) * unit


@jit
def grey_of_numbers(pixels: Array, start: int, step: int, middle: int, last: int, unit: float, grey: Array) -> None:
    """Numbers of any type, `step` places apart; their other colors are `middle` and `last` places on."""
    for x in range(grey.shape[0]):
        k = np.uintp(start + step * x)
        total = np.float32(pixels[k]) + np.float32(pixels[k + np.uintp(middle)])
        grey[x] = (total + np.float32(pixels[k + np.uintp(last)])) * unit


@jit
def high_pass(grey: Array, low: Array, start: int, settle: bool, a: float, new_low: Array, size: Array) -> None:
    """One step of `NDMin` of a row of pixels.

    Args:
        grey, low, new_low: pixels, the state before and after, `[n]`; the row begins at `start`.
        settle: the filter starts at rest on these pixels.
        a: share of the low-pass.
        size: becomes the magnitude of the output.
    """
    first = np.uintp(start)
    if settle:
        blend(grey, grey, np.float32(0), grey, first, new_low, size)
    # As `torch.lerp` rounds it: from the nearer end.
    elif a < 0.5:
        blend(low, grey, np.float32(a), grey, first, new_low, size)
    else:
        blend(grey, low, np.float32(1 - a), grey, first, new_low, size)


@jit(exact=True)
def blend(one: Array, other: Array, share: float, grey: Array, first: Any, out: Array, size: Array) -> None:
    """Means of two rows, and how far they are from the pixels."""
    for x in range(size.shape[0]):
        k = first + np.uintp(x)
        mean = one[k] + share * (other[k] - one[k])
        out[k] = mean
        size[np.uintp(x)] = abs(grey[k] - mean)


@jit
def is_finite(values: Array) -> bool:
    """Whether all numbers of an array without gaps are."""
    flat, total = values.reshape(-1), np.float32(0)
    for x in range(flat.shape[0]):
        total += flat[x] * np.float32(0)
    return bool(total == 0)


@jit
def cell_maxima(grey: Array, settle: bool, low: Array, gain: float, a: float, new_low: Array, cells: Array) -> float:
    """`NDMin` of both rectangles `[2, h, w]` and its largest magnitude in each cell; returns the largest of all.

    Args:
        gain: factor by which the state is made brighter before.
        cells: becomes the maxima, `[2, bands, blocks]`, top row and leftmost column first.
    """
    _, height, width = low.shape
    _, bands, blocks = cells.shape
    tall, wide = height // bands, width // blocks
    size, peaks, highest = np.empty(width, np.float32), np.empty(width, np.float32), np.int32(0)
    # Magnitudes have the order of their bits, and maxima of whole numbers become vector instructions.
    size_bits, peak_bits = size.view(np.int32), peaks.view(np.int32)
    now, before, after = grey.reshape(-1), low.reshape(-1), new_low.reshape(-1)
    bright = low.dtype.type(gain)
    if bright != low.dtype.type(1) and not settle:
        lit = np.empty(before.size, low.dtype)
        for k in range(before.size):
            lit[k] = before[k] * bright
        before = lit
    for eye in range(2):
        for band in range(bands):
            for x in range(width):
                peak_bits[x] = 0
            for y in range(tall):
                start = ((eye * bands + band) * tall + y) * width
                high_pass(now, before, start, settle, a, after, size)
                for x in range(width):
                    peak_bits[x] = max(peak_bits[x], size_bits[x])
            for block in range(blocks):
                most = np.int32(0)
                for x in range(wide):
                    most = max(most, peak_bits[np.uintp(block * wide) + np.uintp(x)])
                # Here no other block reads any more.
                peak_bits[block] = most
                cells[eye, band, block] = peaks[block]
                highest = max(highest, most)
    peak_bits[0] = highest
    return float(peaks[0])
