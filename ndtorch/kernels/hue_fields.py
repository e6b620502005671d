"""Signals of a camera's fields: hues, shades, what stands out, orientation and motion, averaged and compressed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.pooled import add_row, over_columns
from ndtorch.utils.jit import jit

PLANES = 11
"""Three orientations, three hues, what stands out, three shades, and how sure a hue is."""


class HueNumbers(NamedTuple):
    """Of `CameraParams`, with white and black from here to there."""

    color_inhibition: bool
    compression: bool
    palest: float
    pale: float
    shade: float
    dimmest: float
    white_from: float
    white_to: float
    black_from: float
    black_to: float


@jit
def hue_fields(
    frame: Array,
    ground: Array,
    shown: Array,
    responses: Array,
    margin: tuple[int, int],
    motion: Array,
    p: HueNumbers,
    rows: Array,
    columns: Array,
    signals: Array,
    shades: Array,
    presence: Array,
) -> None:
    """`hues_and_shades`, means over fields, and the signals made of them, as `CameraFrontEnd` does.

    Args:
        frame, ground: `[3, h, w]`; shown: by how much something stands out, `[h, w]`.
        responses: of the orientation filters, `[3, h + 2 m, w + 2 n]` with margins `m, n`.
        motion: means over fields, `[2, R, C]`.
        p: constants.
        rows, columns: weights of the fields' rows and columns.
        signals, shades, presence: become `[R, C, 10]`, `[R, C, 4]` and `[R, C]`.
    """
    _, height, width = frame.shape
    kind, none, one = frame.dtype.type, frame.dtype.type(0), frame.dtype.type(1)
    whites, mean = np.empty(3, frame.dtype), none
    for c in range(3):
        total = none
        for y in range(height):
            for x in range(width):
                total += ground[c, y, x]
        whites[c] = max(total / kind(height * width), kind(p.dimmest))
        mean += whites[c] / kind(3)
    balance = (mean / whites[0], mean / whites[1], mean / whites[2])
    brightest = max(brightest_block(frame, balance), brightest_block(ground, balance))
    light = one / max(brightest, kind(p.dimmest))
    fields = np.empty((PLANES, *presence.shape), frame.dtype)
    lines, sums = np.empty((PLANES, width), frame.dtype), np.zeros((PLANES, rows.shape[0], width), frame.dtype)
    for y in range(height):
        for k in range(3):
            magnitudes(responses[k, margin[0] + y, margin[1] :], lines[k])
        pixel_row(frame[0, y], frame[1, y], frame[2, y], shown[y], balance, light, p, lines)
        for k in range(PLANES):
            add_row(lines[k], rows, y, one, sums[k])
    for k in range(PLANES):
        over_columns(sums[k], columns, fields[k])
    for r in range(presence.shape[0]):
        for c in range(presence.shape[1]):
            least = min(min(fields[0, r, c], fields[1, r, c]), fields[2, r, c])
            here, there = signals[r, c], shades[r, c]
            here[0], here[1] = max(-motion[0, r, c], none), max(motion[0, r, c], none)
            here[2], here[3] = max(motion[1, r, c], none), max(-motion[1, r, c], none)
            for k in range(3):
                # What all orientations share says that something is there, not how it stands.
                here[4 + k], here[7 + k] = fields[k, r, c] - least, fields[3 + k, r, c]
            presence[r, c] = fields[6, r, c]
            plain = fields[7, r, c] + fields[8, r, c] + fields[9, r, c]
            share = min(plain / max(fields[6, r, c], kind(p.palest)), one)
            for k in range(4):
                weight = kind(p.shade) * share if k < 3 else one - share
                there[k] = fields[7 + k, r, c] * weight * weight
            if p.compression:
                for k in range(10):
                    here[k] = math.sqrt(max(here[k], none))
                for k in range(4):
                    there[k] = math.sqrt(max(there[k], none))


@jit
def brightest_block(image: Array, balance: tuple[float, float, float]) -> float:
    """The brightest mean of four by four balanced pixels, over all colors."""
    _, height, width = image.shape
    line, most, first = np.empty(width, image.dtype), image.dtype.type(0), True
    for y in range(0, height, 4):
        line[:] = 0
        for c in range(3):
            add_rows(image[c, y], image[c, y + 1], image[c, y + 2], image[c, y + 3], balance[c], line)
        for x in range(0, width, 4):
            total = line[x] + line[x + 1] + line[x + 2] + line[x + 3]
            most, first = total if first else max(most, total), False
    mean: float = most / image.dtype.type(48)
    return mean


@jit
def add_rows(one: Array, two: Array, three: Array, four: Array, factor: float, line: Array) -> None:
    """Add the sum of four rows, times a factor."""
    for x in range(line.shape[0]):
        line[x] += factor * (one[x] + two[x] + three[x] + four[x])


@jit
def magnitudes(values: Array, sizes: Array) -> None:
    """Of a row."""
    for x in range(sizes.shape[0]):
        sizes[x] = abs(values[x])


@jit
def pixel_row(
    red: Array,
    green: Array,
    blue: Array,
    shown: Array,
    balance: tuple[float, float, float],
    light: float,
    p: HueNumbers,
    lines: Array,
) -> None:
    """Hues, what stands out, shades and how sure the hue is of a row of pixels, into the last eight of `lines`."""
    kind = red.dtype.type
    zero, one, third = kind(0), kind(1), kind(1 / 3)
    pale, palest, inhibited = kind(p.pale), kind(p.palest), p.color_inhibition
    white_from, white_share = kind(p.white_from), kind(1 / (p.white_to - p.white_from))
    black_to, black_share = kind(p.black_to), kind(1 / (p.black_to - p.black_from))
    for x in range(shown.shape[0]):
        r, g, b, out = red[x] * balance[0], green[x] * balance[1], blue[x] * balance[2], shown[x]
        bright = (r + g + b) * third
        hue_r, hue_g, hue_b = max(r - bright, zero), max(g - bright, zero), max(b - bright, zero)
        share = min(max(max(max(hue_r, hue_g), hue_b) / max(pale * bright, palest) - one, zero), one)
        white = min(max((bright * light - white_from) * white_share, zero), one)
        black = min(max((black_to - bright * light) * black_share, zero), one)
        lines[3, x] = (hue_r if inhibited else r) * out
        lines[4, x] = (hue_g if inhibited else g) * out
        lines[5, x] = (hue_b if inhibited else b) * out
        lines[6, x] = out
        plain = (one - share) * out
        lines[7, x], lines[8, x], lines[9, x] = white * plain, (one - white - black) * plain, black * plain
        lines[10, x] = share * out
