"""Compiled: pixels to grey, the high-pass of ND-min, features of both rows, their partners and ranges."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np

from ndtorch.utils.jit import jit

Array = Any
"""A NumPy array."""

EDGE_SIDE, SAME_EDGE, BLUR = 1.5, 1.5, 2
"""The patch of an edge is sampled so many pixels to either side of it, beside its blur; edges less than so many pixels
apart are one; and the blur of an edge reaches over so many pixels on either side."""


KINDS = {bool: np.bool_, int: np.int64, float: np.float64}


def packed(*params: Any, **more: float) -> Array:
    """The numbers of dataclasses, and others by name, as an array `[1]` of records, which kernels take at once."""
    declared = [(p, field) for p in params for field in dataclasses.fields(p) if type(field.default) in KINDS]
    kinds: Any = {field.name: type(field.default) for _, field in declared}
    numbers = {field.name: kinds[field.name](getattr(p, field.name)) for p, field in declared} | more
    record = np.dtype([(name, KINDS[type(value)]) for name, value in numbers.items()], align=True)
    return np.array([tuple(numbers.values())], record)


class Frames(NamedTuple):
    """One frame of each camera, and where in them the rectangles begin that are read."""

    # left, right: uint8 or floating point, `[C, H, W]`, or `[H, W, C]` where colors are `interleaved`;
    # contiguous
    left: Array
    right: Array
    interleaved: bool
    scale: float  # grey is the sum of three colors times this; one color counts three times
    # tops, lefts: first row and column of the rectangle in the left and in the right frame
    tops: tuple[int, int]
    lefts: tuple[int, int]


@jit
def grey_fields(frames: Frames, every: int, grey: Array) -> bool:
    """Grey of every column, or every second, of both rectangles, `[2, h, w]`; returns whether all are finite."""
    finite, unit = True, np.float32(frames.scale)
    for eye in range(2):
        frame = frames.right if eye else frames.left
        pixels, top, left = frame.reshape(-1), frames.tops[eye], frames.lefts[eye]
        if frames.interleaved:
            _, width, colors = frame.shape
            row, step, plane = width * colors, every * colors, 1
        else:
            colors, height, width = frame.shape
            row, step, plane = width, every, height * width
        for y in range(grey.shape[1]):
            start = (top + y) * row + left * (step // every)
            red, green = pixels[start:], pixels[start + colors // 2 * plane :]
            blue, line = pixels[start + (colors - 1) * plane :], grey[eye, y]
            if step == 1:
                for x in range(line.shape[0]):
                    line[x] = (np.float32(red[x]) + np.float32(green[x]) + np.float32(blue[x])) * unit
            elif step == 2:  # loops of one literal step become vector instructions
                for x in range(line.shape[0]):
                    k = 2 * x
                    line[x] = (np.float32(red[k]) + np.float32(green[k]) + np.float32(blue[k])) * unit
            elif step == 3:
                for x in range(line.shape[0]):
                    k = 3 * x
                    line[x] = (np.float32(red[k]) + np.float32(green[k]) + np.float32(blue[k])) * unit
            else:
                for x in range(line.shape[0]):
                    k = 6 * x
                    line[x] = (np.float32(red[k]) + np.float32(green[k]) + np.float32(blue[k])) * unit
            finite = finite and (frame.itemsize == 1 or math.isfinite(line.sum()))
    return finite


@jit
def high_pass(grey: Array, low: Array, settle: bool, a: float, new_low: Array, size: Array) -> None:
    """One step of `NDMin` of a row `[n]`: the new state, and magnitudes of the output; `settle` begins at rest."""
    share = np.float32(a)
    for x in range(size.shape[0]):
        mean = grey[x] if settle else low[x] + share * (grey[x] - low[x])
        new_low[x] = mean
        size[x] = abs(grey[x] - mean)


@jit
def cell_maxima(grey: Array, settle: bool, low: Array, a: float, new_low: Array, cells: Array) -> float:
    """`NDMin` of rectangles `[2, h, w]` and its largest magnitude in each cell; returns the largest of all.

    Args:
        cells: becomes the maxima, `[2, bands, blocks]`, top row and leftmost column first.
    """
    _, height, width = low.shape
    _, bands, blocks = cells.shape
    tall, wide = height // bands, width // blocks
    # Magnitudes have the order of their bits, and maxima of whole numbers become vector instructions.
    size, peaks, highest = np.empty(width, np.float32), np.empty(width, np.float32), np.float32(0)
    size_bits, peak_bits = size.view(np.int32), peaks.view(np.int32)
    for eye in range(2):
        for band in range(bands):
            peaks[:] = 0
            for y in range(tall * band, tall * (band + 1)):
                high_pass(grey[eye, y], low[eye, y], settle, a, new_low[eye, y], size)
                for x in range(width):
                    peak_bits[x] = max(peak_bits[x], size_bits[x])
            for block in range(blocks):
                most = peaks[block * wide : (block + 1) * wide].max()
                cells[eye, band, block] = most
                highest = max(highest, most)
    return float(highest)


@jit
def feature_ranges(
    frames: Frames, settle: bool, low: Array, new_low: Array, numbers: Array, out: Array, valid: Array
) -> float:
    """The step of `StereoRanging` that matches features without prediction; returns the largest motion.

    Args:
        frames: the row that is read of both.
        settle: the filters start at rest on these rows.
        low, new_low: states of the filters, `[2, W]`.
        numbers: of `row_numbers`.
        out: becomes range, left and right angle, x and y, `[5, n]`; `valid`: `[n]`.
    """
    p, width, n = numbers[0], low.shape[1], valid.shape[0]
    rows, motion = np.empty((2, 1, width), np.float32), np.empty(width, np.float32)
    column, strength = np.empty((2, n), np.float32), np.empty((2, n), np.float32)
    patch, good, most = np.empty((2, n, 3), np.float32), np.empty((2, n), np.bool_), np.float32(0)
    finite = grey_fields(frames, 1, rows)
    for eye in range(2):
        row = rows[eye, 0]
        high_pass(row, low[eye], settle, p.a, new_low[eye], motion)
        most = max(most, motion.max())
        for x in range(p.border):
            motion[width - 1 - x if eye else x] = 0
        strongest(motion, p.spacing_px, column[eye], strength[eye])
        describe(row, column[eye], strength[eye], numbers, patch[eye], good[eye])
    match(column, patch, good, numbers, out[0], valid)
    triangulate(column[0], numbers, out, valid)
    return float(most) if finite else np.nan


@jit(exact=True)
def strongest(motion: Array, spacing: int, column: Array, strength: Array) -> None:
    """The largest of `motion` `[W]`, one after the other; it is spoiled."""
    width = motion.shape[0]
    motion[0] = motion[width - 1] = -1
    bits = motion.view(np.int32)  # in the order of the numbers where these are positive
    for k in range(column.shape[0]):
        most = bits[1]
        for x in range(2, width):
            most = max(most, bits[x])
        best = 1
        while best < width - 2 and bits[best] != most:
            best += 1
        column[k], strength[k] = best, motion[best]
        for x in range(max(0, best - spacing), min(best + spacing + 1, width)):
            motion[x] = -1


@jit(exact=True)
def edge_place(row: Array, column: int, reach: int) -> float:
    """Where the edge is that made the motion at a column, see `edge_places`."""
    width, edge, size = row.shape[0], 0, np.float32(-1)
    for k in range(column - reach - 1, column + reach + 1):
        at = min(max(k, 0), width - 2)
        step = abs(row[at + 1] - row[at])
        if step > size:
            edge, size = at, step
    sign, total, moment = np.sign(row[edge + 1] - row[edge]), np.float32(0), np.float32(0)
    for k in range(edge - BLUR, edge + BLUR + 1):
        at = min(max(k, 0), width - 2)
        weight = max((row[at + 1] - row[at]) * sign, np.float32(0))
        total, moment = total + weight, moment + weight * np.float32(at - edge)
    place = edge + 0.5 + (moment / total if total > 0 else 0.0)
    return float(min(max(place, 1.0), width - 2.0))


@jit(exact=True)
def patch_error(one: Array, other: Array) -> float:
    a, b, c = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    total: float = a * a + b * b + c * c
    return total


@jit(exact=True)
def describe(row: Array, column: Array, strength: Array, numbers: Array, patch: Array, good: Array) -> None:
    """`describe` of `ndtorch.navigation.stereo.features`: places, patches `[n, 3]`, and which features are good."""
    p, n, width = numbers[0], column.shape[0], row.shape[0]
    for i in range(n):
        if p.edge_reach_px:
            column[i] = edge_place(row, int(column[i]), p.edge_reach_px)
        for k in range(3):
            place = column[i] + (EDGE_SIDE if p.edge_reach_px else 1.0) * (k - 1)
            place = min(max(place, 0.0), width - 1.0)
            low = min(int(place), width - 2)
            patch[i, k] = row[low] + np.float32(place - low) * (row[low + 1] - row[low])
        good[i] = strength[i] >= p.min_motion
    twin = np.zeros(n, np.bool_)
    for i in range(n):
        for j in range(n if p.edge_reach_px else 0):
            weaker = strength[i] < strength[j] or (strength[i] == strength[j] and j < i)
            twin[i] = twin[i] or (weaker and abs(column[i] - column[j]) < SAME_EDGE)
    for i in range(n):
        good[i] = good[i] and not twin[i]
        for j in range(n):
            alike = i != j and not twin[j] and patch_error(patch[i], patch[j]) < p.min_difference
            good[i] = good[i] and not alike


@jit(exact=True)
def match(column: Array, patch: Array, good: Array, numbers: Array, partner: Array, valid: Array) -> None:
    """`match_features` of both rows, `[2, n]`: the partner's column of every left feature, and whether it is one."""
    p, n = numbers[0], column.shape[1]
    error = np.full((n, n), np.inf)
    for i in range(n):
        for j in range(n):
            if good[0, i] and good[1, j]:
                error[i, j] = patch_error(patch[0, i], patch[1, j])
    for i in range(n):
        j = error[i].argmin()
        partner[i] = column[1, j]
        apart = column[0, i] - column[1, j]
        valid[i] = error[i, j] < p.max_error and p.min_disparity_px < apart < p.max_disparity_px
        valid[i] = valid[i] and (not p.one_to_one or error[:, j].argmin() == i)


@jit(exact=True)
def triangulate(column: Array, numbers: Array, out: Array, valid: Array) -> None:
    """Range, left and right angle, x and y into `out` `[5, n]`, whose first line holds the right columns before.

    Args:
        column: left columns, `[n]`.
        valid: `[n]`; what is not valid, or does not meet ahead, becomes 0.
    """
    p = numbers[0]
    for i in range(len(column)):
        left, right = (p.axis - column[i]) * p.factor, (p.axis - out[0, i]) * p.factor
        if p.exact:
            left, right = math.atan(left), math.atan(right)
        valid[i] = valid[i] and right > left
        out[:, i] = 0
        if valid[i]:
            distance = p.baseline * math.cos(right) / math.sin(right - left)
            out[0, i], out[1, i], out[2, i] = distance, left, right
            out[3, i], out[4, i] = p.forward + distance * math.cos(left), p.baseline / 2 + distance * math.sin(left)
