"""Compiled passes over the pixels of a frame: comparison with the background, shadows, learning, sums of blobs."""

from __future__ import annotations

from typing import Any

import numpy as np

from ndtorch.utils.jit import jit

Array = Any
"""An array in a compiled function."""


@jit
def light_ratios(image: Array, background: Array, dark: float, step: int, ratios: Array) -> int:
    """Ratios of each color to a background `[3, h, w]` lighter than `dark`, at every so many pixels; their number."""
    n = 0
    for y in range(0, image.shape[1], step):
        for x in range(0, image.shape[2], step):
            red, green, blue = background[0, y, x], background[1, y, x], background[2, y, x]
            if min(red, min(green, blue)) > dark:
                ratios[0, n], ratios[1, n], ratios[2, n] = (
                    image[0, y, x] / red,
                    image[1, y, x] / green,
                    image[2, y, x] / blue,
                )
                n += 1
    return n


@jit
def compare(raw: Array, gain: Array, mean: Array, image: Array, distance: Array) -> None:
    """The image without its gain, and its distance from the background, the largest of the colors."""
    r_gain, g_gain, b_gain = gain[0], gain[1], gain[2]
    for y in range(raw.shape[1]):
        for x in range(raw.shape[2]):
            red, green, blue = raw[0, y, x] / r_gain, raw[1, y, x] / g_gain, raw[2, y, x] / b_gain
            image[0, y, x], image[1, y, x], image[2, y, x] = red, green, blue
            apart = max(abs(red - mean[0, y, x]), abs(green - mean[1, y, x]))
            distance[y, x] = max(apart, abs(blue - mean[2, y, x]))


@jit
def mark_candidates(
    distance: Array, deviation: Array, mean_size: float, noise: float, threshold: float, sigma: Array, marks: Array
) -> int:
    """Noise of every pixel, and 1 where the distance is more than a multiple of it; the number of these pixels."""
    kind, count = distance.dtype.type, 0
    size, least, times = kind(mean_size), kind(noise), kind(threshold)
    for y in range(distance.shape[0]):
        some = np.int32(0)
        for x in range(distance.shape[1]):
            own = max(deviation[y, x] / size, least)
            sigma[y, x] = own
            marks[y, x] = np.uint8(distance[y, x] > times * own)
            some += np.int32(marks[y, x])
        count += int(some)
    return count


@jit
def mark_motion(
    smooth: Array, previous: Array, candidates: Array, known: Array, least: float, least_color: float, marks: Array
) -> float:
    """1 where the image changed, or where candidates are on no known background; the mean change of brightness."""
    kind, total = smooth.dtype.type, 0.0
    third, grey, color = kind(1 / 3), kind(least), kind(least_color)
    for y in range(smooth.shape[1]):
        some = kind(0)
        for x in range(smooth.shape[2]):
            red = smooth[0, y, x] - previous[0, y, x]
            green = smooth[1, y, x] - previous[1, y, x]
            blue = smooth[2, y, x] - previous[2, y, x]
            change = abs(red + green + blue) * third
            colored = max(max(abs(red), abs(green)), abs(blue))
            new = np.uint8(candidates[y, x] > known[y, x])
            marks[y, x] = np.uint8(change > grey) | np.uint8(colored > color) | new
            some += change
        total += float(some)
    return float(total / (smooth.shape[1] * smooth.shape[2]))


@jit
def follow_rest(
    moved: Array, known: Array, candidates: Array, dt: float, trail: float, static: Array, mask: Array, recent: Array
) -> int:
    """Seconds without motion; candidates on the known background, and what moved lately elsewhere, its number."""
    kind, lately = static.dtype.type, 0
    step, limit = kind(dt), kind(trail)
    for y in range(moved.shape[0]):
        some = np.int32(0)
        for x in range(moved.shape[1]):
            still = kind(0) if moved[y, x] else static[y, x] + step
            static[y, x] = still
            mask[y, x] = candidates[y, x] & known[y, x]
            recent[y, x] = np.uint8(still < limit) & (np.uint8(1) ^ known[y, x])
            some += np.int32(recent[y, x])
        lately += int(some)
    return lately


@jit
def shadow_marks(
    image: Array,
    background: Array,
    top: int,
    left: int,
    offset: float,
    limits: tuple[float, float, float],
    light: Array,
    marks: Array,
) -> None:
    """Mean ratio of the colors to the background in a window, and 1 where it is that of a shadow, 3 of a narrow one.

    Args:
        limits: smallest ratio, largest tint of a shadow and of a narrow one.
        light, marks: of the window.
    """
    kind = image.dtype.type
    own, third, low, tint, pale = kind(offset), kind(1 / 3), kind(limits[0]), kind(limits[1]), kind(limits[2])
    for y in range(light.shape[0]):
        for x in range(light.shape[1]):
            red = (image[0, top + y, left + x] + own) / (background[0, top + y, left + x] + own)
            green = (image[1, top + y, left + x] + own) / (background[1, top + y, left + x] + own)
            blue = (image[2, top + y, left + x] + own) / (background[2, top + y, left + x] + own)
            mean = (red + green + blue) * third
            apart = max(max(red, green), blue) - min(min(red, green), blue)
            dim = np.uint8(mean < kind(1)) & np.uint8(mean > low) & np.uint8(apart <= tint * mean)
            marks[y, x] = dim | ((dim & np.uint8(apart <= pale * mean)) << np.uint8(1))
            light[y, x] = mean


@jit
def learn_pixels(
    image: Array,
    distance: Array,
    sigma: Array,
    kept: Array,
    static: Array,
    paces: tuple[float, float, float, float, float],
    mean: Array,
    deviation: Array,
    known: Array,
) -> None:
    """Let mean and deviation follow where `kept` is 0; where no background is known, the mean since something moved.

    Args:
        paces: of mean and deviation, largest deviation learned in its present values, seconds of a frame, and seconds
            without motion after which the background is known.
    """
    kind = image.dtype.type
    pace, slow, outlier, step, needed = kind(paces[0]), kind(paces[1]), kind(paces[2]), kind(paces[3]), kind(paces[4])
    none = kind(0)
    for y in range(image.shape[1]):
        for x in range(image.shape[2]):
            free = known[y, x] > kept[y, x]
            share = pace if free else (none if known[y, x] else step / (static[y, x] + step))
            for c in range(3):
                mean[c, y, x] += share * (image[c, y, x] - mean[c, y, x])
            usual = min(distance[y, x], outlier * sigma[y, x])
            deviation[y, x] += (slow if free else none) * (usual - deviation[y, x])
            known[y, x] |= np.uint8(static[y, x] >= needed)


@jit
def look_up(table: Array, labels: Array, values: Array) -> None:
    """The value of each label `[h, w]` in a table."""
    for y in range(labels.shape[0]):
        for x in range(labels.shape[1]):
            values[y, x] = table[labels[y, x]]


@jit
def sum_blobs(labels: Array, image: Array, distance: Array, sigma: Array, sums: Array) -> None:
    """Of each label: pixels, left, top, right and bottom, and sums of column, row, red, green, blue and contrast.

    Args:
        sums: become these, a row for each label without 0, `[N, 11]`.
    """
    for n in range(sums.shape[0]):
        sums[n, 0], sums[n, 3], sums[n, 4] = 0.0, 0.0, 0.0
        sums[n, 1], sums[n, 2] = labels.shape[1], labels.shape[0]
        for k in range(5, 11):
            sums[n, k] = 0.0
    for y in range(labels.shape[0]):
        for x in range(labels.shape[1]):
            if labels[y, x] > 0:
                own = sums[labels[y, x] - 1]
                own[0] += 1
                own[1], own[2] = min(own[1], x), min(own[2], y)
                own[3], own[4] = max(own[3], x + 1), max(own[4], y + 1)
                own[5] += x
                own[6] += y
                for c in range(3):
                    own[7 + c] += image[c, y, x]
                own[10] += distance[y, x] / sigma[y, x]


@jit
def mark_static(
    mask: Array, static: Array, known: Array, labels: Array, moving: Array, after: float, marks: Array
) -> int:
    """1 for foreground without motion for `after` seconds, on known background and of no moving track; their number."""
    count = 0
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            marks[y, x] = np.uint8(mask[y, x] and known[y, x] and static[y, x] >= after and not moving[labels[y, x]])
            count += marks[y, x]
    return count
