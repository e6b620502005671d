"""A whole step of a car with the ranging controller: from the pixels to the command."""

from __future__ import annotations

from typing import Any

import numpy as np

from ndtorch.kernels.decision import NUMBERS as DECISION
from ndtorch.kernels.grey import grey_row
from ndtorch.kernels.light_gain import grey_gain
from ndtorch.kernels.look_around import NUMBERS, WHOLE_NUMBERS, look_around
from ndtorch.kernels.match_cells import compare_cells
from ndtorch.kernels.ranging_control import ranging_control
from ndtorch.kernels.strips import larger
from ndtorch.utils.jit import jit

Array = Any

seen, controlled = look_around, ranging_control

FLOOR, WORTH, PATCH, LIMITS = 14, 3, 9, len(DECISION)
"""How many numbers `ranging_control` takes of each."""


@jit
def ranging_step(
    left_field: Array,
    right_field: Array,
    left_row: Array,
    right_row: Array,
    whole: Array,
    numbers: Array,
    dt: float,
    drift: float,
    scale: float,
    settle: bool,
    given: bool,
    speed: float,
    curvature: float,
    large: Array,
    small: Array,
    new_large: Array,
    new_small: Array,
    valid: Array,
    flow: Array,
    profile: Array,
    places: Array,
    under: Array,
    line: Array,
    comparison: Array,
    table: Array,
    moves: Array,
    full: Array,
    lines: Array,
    shift: Array,
) -> tuple[float, float, bool]:
    """The step of `Navigator` of one car and one frame: arguments and result as of `published_step`.

    The controller's whole numbers are the size of the patch; `leading`, steps and number of its arcs; `first`, `wide`
    and `tall` of `match_cells`, the columns of the fields, every so many of them; and the side of what stands, or 0.
    Its others are those of `ranging_control`, the length of a step of its arcs, the least noise of pictures, the
    shares of bands up to which a car stands and from which on it is fast, the mode in which it stands, `alike` and
    `least` of `match_cells`, `limits` of `light_gain`, `beam` of `ranging_control`, and below which share of what it
    was noise has not settled.

    Args:
        flow, profile, places, under, line: `tables` of `ranging_control`.
        comparison, table, moves: `choice` of `ranging_control`.
        full: share of its level that floor shows at full speed, `[bands]`.
        lines, shift: rows and shift of `match_cells`.
    """
    bands, blocks, at = whole[9], whole[10], whole[23]
    found, cells = np.empty((2, bands, blocks), large.dtype), np.empty((4, bands, blocks), large.dtype)
    eyes = (left_field, right_field, left_row, right_row)
    driven = (speed, curvature) if given else (float(small[0]), float(small[1]))
    own, gain = whole[WHOLE_NUMBERS:], 1.0
    rest = numbers[NUMBERS + FLOOR + WORTH + PATCH + LIMITS + 1 :]
    height, width, first = whole[11], whole[12], (own[4], own[5])
    grey, wider = np.empty((2, height, width), large.dtype), np.empty((2, lines.size, own[8]), large.dtype)
    grey_once((left_field[0], right_field[0]), whole, numbers[0], lines, first, grey, wider)
    compare_cells(wider, lines, shift, first, own[6], own[7], rest[4], rest[5], cells[2:], new_large)
    if not settle:
        low = large[: 2 * height * width].reshape((2, height, width))
        gain = grey_gain(grey, height // bands, low, blocks, (float(rest[6]), float(rest[7]), float(rest[8])))
    largest = seen(
        eyes,
        whole,
        numbers,
        (dt, drift, scale),
        settle,
        driven,
        (large, small),
        (new_large, new_small),
        valid,
        grey,
        gain,
        found,
    )
    kind = found.dtype.type
    peak = kind(0)
    for eye in range(2):
        highest = kind(0)
        for band in range(bands):
            for block in range(blocks):
                # The nearest band is the first, and the outermost block too.
                worth = found[eye, bands - 1 - band, blocks - 1 - block if eye else block]
                highest = larger(worth, highest)
                cells[eye, band, block] = worth * kind(numbers[3])
        peak = larger(highest, peak)
        new_small[at + eye] = highest * kind(numbers[3])
    worths, patch = NUMBERS + FLOOR, NUMBERS + FLOOR + WORTH
    limits = patch + PATCH
    now = small[:at].copy()
    now[0], now[1] = driven
    now[2], now[3], now[4] = new_small[2], new_small[3], new_small[4]
    size, leading, steps, arcs = own[0], own[1], own[2], own[3]
    n = whole[14]
    out = new_small[at + 4 : at + 4 + 5 * n].reshape((5, n))
    # Behind fields and rows: level, evidence, tag, what stands, and trail.
    begin = 2 * whole[11] * whole[12] + 2 * whole[13]
    middle, end = begin + bands, begin + bands + size * size
    stands, side = end + 2 * size, own[9]
    last = stands + side * side
    floor = (
        numbers[NUMBERS + 0],
        numbers[NUMBERS + 1],
        numbers[NUMBERS + 2],
        numbers[NUMBERS + 3],
        numbers[NUMBERS + 4],
        numbers[NUMBERS + 5],
        numbers[NUMBERS + 6],
        numbers[NUMBERS + 7],
        numbers[NUMBERS + 8],
        numbers[NUMBERS + 9],
        numbers[NUMBERS + 10],
        numbers[NUMBERS + 11],
        numbers[NUMBERS + 12],
        numbers[NUMBERS + 13],
    )
    controlled(
        cells,
        (out[3], out[4], valid),
        now,
        (
            large[begin:middle],
            large[middle:end].reshape((size, size)),
            large[end:stands].reshape((2, size)),
            large[stands:last].reshape((side, side)),
            large[last:].reshape((-1, 3)),
        ),
        (
            new_large[begin:middle],
            new_large[middle:end].reshape((size, size)),
            new_large[end:stands].reshape((2, size)),
            new_large[stands:last].reshape((side, side)),
            new_large[last:].reshape((-1, 3)),
        ),
        new_small,
        (flow, profile, places, under, line),
        floor,
        (numbers[worths + 0], numbers[worths + 1], numbers[worths + 2]),
        (
            numbers[patch + 0],
            numbers[patch + 1],
            numbers[patch + 2],
            numbers[patch + 3],
            numbers[patch + 4],
            numbers[patch + 5],
            numbers[patch + 6],
            numbers[patch + 7],
            numbers[patch + 8],
        ),
        (leading, steps, arcs, numbers[limits + LIMITS]),
        (comparison, table, moves),
        (
            numbers[limits + 0],
            numbers[limits + 1],
            numbers[limits + 2],
            numbers[limits + 3],
            numbers[limits + 4],
            numbers[limits + 5],
            numbers[limits + 6],
            numbers[limits + 7],
            numbers[limits + 8],
            numbers[limits + 9],
            numbers[limits + 10],
            numbers[limits + 11],
            numbers[limits + 12],
            numbers[limits + 13],
            numbers[limits + 14],
            numbers[limits + 15],
            numbers[limits + 16],
            numbers[limits + 17],
            numbers[limits + 18],
        ),
        (float(rest[9]), float(rest[10]), float(rest[11]), float(rest[12])),
    )
    learning = new_small[6] <= kind(floor[6])
    if not learning:
        # As `known_share` and `RangingControl.caution`.
        noise, known = max(new_small[5], kind(rest[0])) * kind(floor[4]), 0
        for band in range(bands):
            known += new_large[begin + band] * full[band] > noise
        share = min(max((kind(known) / kind(bands) - kind(rest[1])) / kind(rest[2] - rest[1]), kind(0)), kind(1))
        if new_small[0] > 0:
            new_small[0] *= share
        if share <= 0 or (share < 1 and new_small[5] < kind(rest[13]) * small[5]):
            new_small[0], new_small[1], new_small[7] = 0, 0, rest[3]
    new_small[at + 2], new_small[at + 3] = new_small[0], new_small[1]
    return float(peak), largest, learning


@jit
def copy_from(row: Array, start: int, part: Array) -> None:
    """Some of a row, from a column on."""
    for x in range(part.shape[0]):
        part[x] = row[start + np.uintp(x)]


@jit
def grey_once(
    fields: tuple[Array, Array],
    whole: Array,
    unit: float,
    lines: Array,
    first: tuple[int, int],
    grey: Array,
    wider: Array,
) -> None:
    """Every row of pixels once, see `grey_row`.

    Args:
        fields: both frames of them, `[C, H, W]` or `[H, W, C]`.
        whole, unit: of `look_around`.
        lines: which rows are compared, in order, `[R]`.
        first: by how many columns they begin farther left.
        grey: becomes the fields, `[2, h, w]`.
        wider: becomes the rows that are compared, `[2, R, width]`.
    """
    beside, every = whole[0] != 0, whole[8]
    height = grey.shape[1]
    for eye in range(2):
        r, left, top = 0, whole[4 + eye], whole[2 + eye]
        for y in range(height):
            if r < lines.size and lines[r] == y:
                start = first[eye]
                grey_row(fields[eye], beside, top + y, left - every * start, every, unit, whole[7], wider[eye, r])
                copy_from(wider[eye, r], np.uintp(start), grey[eye, y])
                r += 1
            else:
                grey_row(fields[eye], beside, top + y, left, every, unit, whole[7], grey[eye, y])
