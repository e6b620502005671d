"""Compiled passes over masks of tracks: measurements, marks, patches and white balance."""

from __future__ import annotations

from math import ceil, floor
from typing import NamedTuple

import numpy as np

from ndtorch.foreground.arrays import Array
from ndtorch.foreground.morphology import any_nonzero
from ndtorch.foreground.noise import MEAN_SIZE
from ndtorch.utils.jit import jit

SAMPLED = 4
"""Colors are measured at every so many pixels of a mask; patches of this side may be the brightest."""


class WhiteBalanceNumbers(NamedTuple):
    """`WhiteBalance` as numbers: gain of each color, brightest patch, and limits of hue, white and black."""

    gains: tuple[float, float, float]
    brightest: float
    min_hue: float
    min_hue_ratio: float
    white: tuple[float, float]
    black: tuple[float, float]


class MeasuredImages(NamedTuple):
    """Image, background and its deviation, `[3, h, w]`, and noise of each color, `[3]`."""

    image: Array
    background: Array
    deviation: Array
    noise: Array


@jit
def measure_masks(
    labels: Array, slots: Array, doubted: Array, images: MeasuredImages, p: WhiteBalanceNumbers, table: Array
) -> None:
    """See `ndtorch.tracking.masks.measure_detections`.

    Args:
        labels: number of the track of every pixel plus one, `[h, w]` int32.
        slots: row of the table for each such number, `[n]` int32.
        doubted: tracks whose contrast is measured, `[K]` bool.
        table: becomes top, left, bottom, right, pixels, row and column of the pixel nearest to their mean, three
            colors, shares of white, grey, black and hues, and the mean contrast of each track, `[K, 15]` float64; all
            zero for tracks without pixels.
    """
    image, background, deviation, noise = images
    balance = p.gains
    height, width = labels.shape
    count, kind = table.shape[0], image.dtype.type
    own, third, one, none = kind(1 / MEAN_SIZE), kind(3), kind(1), kind(0)
    white, black = kind(p.white[1] - p.white[0]), kind(p.black[1] - p.black[0])
    sums, looked = np.zeros((count, 2)), np.zeros(count)
    for k in range(count):
        for n in range(15):
            table[k, n] = 0
        table[k, 0], table[k, 1] = height, width
    for y in range(height):
        end = 0
        while end < width and any_nonzero(labels[y, end:]):
            # Run after run: numbers of a table are slow to change.
            start = end
            while labels[y, start] <= 0:
                start += 1
            name, end = labels[y, start], start + 1
            while end < width and labels[y, end] == name:
                end += 1
            k, count_before, length = slots[name], int(table[slots[name], 4]), end - start
            row = table[k]
            row[0], row[1], row[2], row[3] = min(row[0], y), min(row[1], start), y + 1, max(row[3], end)
            for c in range(3):
                row[7 + c] += sum_of(image[c, y, start:end])
            sums[k, 0] += y * length
            sums[k, 1] += (start + end - 1) * length / 2
            row[4] += length
            for x in range(start, end if doubted[k] else start):
                most = none
                for c in range(3):
                    least = max(deviation[c, y, x] * own, noise[c])
                    most = max(most, abs(image[c, y, x] - background[c, y, x]) / least)
                row[14] += most
            for x in range(start + -count_before % SAMPLED, end, SAMPLED):
                red, green, blue = image[0, y, x], image[1, y, x], image[2, y, x]
                red, green, blue = red * kind(balance[0]), green * kind(balance[1]), blue * kind(balance[2])
                bright = (red + green + blue) / third
                hue = (max(red, green, blue) - bright) / max(kind(p.min_hue_ratio) * bright, kind(p.min_hue)) - one
                hue = min(max(hue, none), one)
                share = bright / kind(p.brightest)
                pale = min(max((share - kind(p.white[0])) / white, none), one)
                dark = min(max((kind(p.black[1]) - share) / black, none), one)
                row[10] += pale * (one - hue)
                row[11] += (one - pale - dark) * (one - hue)
                row[12] += dark * (one - hue)
                row[13] += hue
                looked[k] += 1
    for k in range(count):
        row, pixels = table[k], max(table[k, 4], 1)
        for n in range(7, 10):
            row[n] /= pixels
        for n in range(10, 14):
            row[n] /= max(looked[k], 1)
        row[14] /= pixels
        if row[4] == 0:
            row[0] = row[1] = 0
            continue
        # The pixel nearest to the middle, and the nearest point in it: several pixels may be as near.
        down, across = sums[k, 0] / pixels, sums[k, 1] / pixels
        least, best_row, best_column = 1e30, 0, 0
        for y in range(int(row[0]), int(row[2])):
            for x in range(int(row[1]), int(row[3])):
                name = labels[y, x]
                if name > 0 and slots[name] == k:
                    away = (y - down) ** 2 + (x - across) ** 2
                    if away < least:
                        least, best_row, best_column = away, y, x
        row[5] = min(max(down, best_row - 0.5), best_row + 0.5) + 0.5
        row[6] = min(max(across, best_column - 0.5), best_column + 0.5) + 0.5


@jit
def sum_of(values: Array) -> float:
    total = 0.0
    for x in range(values.shape[0]):
        total += values[x]
    return total


@jit
def mark_tracks(labels: Array, marks: Array, mask: Array, kept: Array) -> None:
    """See `ndtorch.tracking.masks.object_mask`.

    Args:
        labels: number of the track of every pixel plus one, `[h, w]` int32.
        marks: whether it is an object, and what `kept` becomes under it, `[n, 2]` uint8.
        mask: becomes the first of every pixel, `[h, w]` uint8.
        kept: becomes the largest second of a pixel and those beside it, `[h, w]` float32.
    """
    height, width = labels.shape
    wide = np.zeros((height + 2, width + 2), np.uint8)
    mask[:], some = 0, np.zeros(height + 2, np.bool_)
    for y in range(height):
        some[y + 1] = any_nonzero(labels[y])
        for x in range(width if some[y + 1] else 0):
            number = labels[y, x]
            if number > 0:
                mask[y, x], wide[y + 1, x + 1] = marks[number, 0], marks[number, 1]
    line = np.empty(width + 2, np.uint8)
    for y in range(height):
        if not (some[y] or some[y + 1] or some[y + 2]):
            kept[y] = 0
            continue
        upper, middle, lower = wide[y], wide[y + 1], wide[y + 2]
        for x in range(width + 2):
            line[x] = upper[x] | middle[x] | lower[x]
        left, right = line[1 : width + 1], line[2 : width + 2]
        for x in range(width):
            kept[y, x] = line[x] | left[x] | right[x]


@jit
def patch_distance(
    image: Array, background: Array, boxes: Array, before: Array, patches: Array, distance: Array
) -> None:
    """Patches of the image less the background in boxes, and their distances from an earlier patch.

    Args:
        image, background: `[3, h, w]`.
        boxes: top, left, bottom and right of each, pixels, `[K, 4]` int64.
        before: what was seen before, `[3, P, P]`.
        patches: become the difference of image and background in each box, `[K, 3, P, P]`.
        distance: becomes the mean squared difference of that and what was seen before, `[K]` float64.
    """
    _, height, width = image.shape
    side = before.shape[1]
    line = np.empty(side, np.float64)
    for k in range(boxes.shape[0]):
        top, left = min(max(boxes[k, 0], 0), height - 1), min(max(boxes[k, 1], 0), width - 1)
        bottom, right = min(max(boxes[k, 2], top + 1), height), min(max(boxes[k, 3], left + 1), width)
        tall, wide = bottom - top, right - left
        shrinks = min(tall, wide) > side
        rows, columns = weights_of(tall, side, shrinks), weights_of(wide, side, shrinks)
        total = 0.0
        for c in range(3):
            patch = patches[k, c]
            patch[:] = 0
            for y in range(tall):
                here, there = image[c, top + y, left:right], background[c, top + y, left:right]
                for i in range(side):
                    line[i] = 0
                    for x in range(np.uint64(columns[i, wide]), np.uint64(columns[i, wide + 1])):
                        line[i] += columns[i, x] * (here[x] - there[x])
                for j in range(side):
                    if rows[j, y] > 0:
                        for i in range(side):
                            patch[j, i] += rows[j, y] * line[i]
            for j in range(side):
                for i in range(side):
                    total += (patch[j, i] - before[c, j, i]) ** 2
        distance[k] = total / (3 * side * side)


@jit
def weights_of(size: int, side: int, shrinks: bool) -> Array:
    """What each of `size` pixels counts for in each of `side` new ones, as OpenCV's INTER_AREA has it where it shrinks
    and INTER_LINEAR otherwise, `[side, size + 2]`; in the end the first that counts, and the one after the last."""
    weights, scale = np.zeros((side, size + 2)), size / side
    for n in range(side):
        if shrinks:
            start, end = n * scale, min((n + 1) * scale, float(size))
            first, last = floor(start), ceil(end - 1e-9)
            for k in range(first, last):
                weights[n, k] = max(0.0, min(end, k + 1.0) - max(start, float(k))) / (end - start)
        else:
            at = (n + 0.5) * scale - 0.5
            first = min(max(floor(at), 0), size - 1)
            share = at - first if 0 <= at < size - 1 else 0.0
            weights[n, first] = 1 - share
            last = first + 1
            if share > 0:
                weights[n, last] = share
                last += 1
        weights[n, size], weights[n, size + 1] = first, last
    return weights


@jit
def measure_white_balance(image: Array, background: Array, dimmest: float, balance: Array) -> float:
    """Gains under which the background is grey on average, and the brightest patch of image and background.

    Args:
        image, background: `[3, h, w]`; the sides are multiples of `SAMPLED`.
        dimmest: smallest mean of a color.
        balance: becomes the gains, `[3]`.
    """
    _, height, width = image.shape
    kind = image.dtype.type
    mean = 0.0
    for c in range(3):
        total = 0.0
        for y in range(0, height, SAMPLED):
            for x in range(0, width, SAMPLED):
                total += background[c, y, x]
        balance[c] = max(total / ((height // SAMPLED) * (width // SAMPLED)), dimmest)
        mean += balance[c] / 3
    for c in range(3):
        balance[c] = mean / balance[c]
    red, green, blue = balance[0], balance[1], balance[2]
    most, line = kind(0), np.empty(width, image.dtype)
    for which in range(2):
        source = background if which else image
        for top in range(0, height, SAMPLED):
            line[:] = 0
            for y in range(top, top + SAMPLED):
                add_bright(source[0, y], source[1, y], source[2, y], (red, green, blue), line)
            for left in range(0, width, SAMPLED):
                sum_of = kind(0)
                for x in range(left, left + SAMPLED):
                    sum_of += line[x]
                most = max(most, sum_of)
    return float(most) / (3 * SAMPLED * SAMPLED)


@jit
def add_bright(red: Array, green: Array, blue: Array, balance: tuple[float, float, float], line: Array) -> None:
    """Add the brightness of a row."""
    for x in range(line.shape[0]):
        line[x] += balance[0] * red[x] + balance[1] * green[x] + balance[2] * blue[x]
