"""Compiled functions of the camera monitor: image statistics, change of an image, correlations of stereo patches."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[Any]

BLOCK = 4
"""Pixels of a block."""

TAIL = 50
"""The range of a row leaves out one of this many block means at either end."""


@jit
def image_statistics(
    row: Floats,
    field: Floats,
    scale: float,
    row_means: Floats,
    field_means: Floats,
    row_detail: Floats,
    field_detail: Floats,
) -> tuple[float, float, float, float, float, float, float, float]:
    """Block means of an image, the same without shading, and the fields of `ImageStatistics`.

    Args:
        row, field: `[W]` and `[h, w]`; times `scale` they are levels of 255.
        row_means, field_means: filled, `[W / 4]` and `[h / 4, w / 4]`.
        row_detail, field_detail: filled, `[W / 4 - 2 lag]` and `[h / 4, w / 4 - 2 lag]`.
    """
    width, columns = len(row), len(row_means)
    high, wide = field_means.shape
    share = scale / BLOCK
    for c in range(columns):
        x = BLOCK * c
        row_means[c] = (row[x] + row[x + 1] + row[x + 2] + row[x + 3]) * share
    share = scale / BLOCK**2
    sums = np.empty(wide * BLOCK, row.dtype)
    for r in range(high):
        for x in range(wide * BLOCK):
            y = BLOCK * r
            sums[x] = field[y, x] + field[y + 1, x] + field[y + 2, x] + field[y + 3, x]
        for c in range(wide):
            x = BLOCK * c
            field_means[r, c] = (sums[x] + sums[x + 1] + sums[x + 2] + sums[x + 3]) * share
    lag = (columns - len(row_detail)) // 2
    half = 0.5 if lag > 0 else 0.0
    for c in range(len(row_detail)):
        row_detail[c] = row_means[c + lag] - (row_means[c] + row_means[c + 2 * lag]) * half
    lag = (wide - field_detail.shape[1]) // 2
    half = 0.5 if lag > 0 else 0.0
    for r in range(high):
        for c in range(field_detail.shape[1]):
            field_detail[r, c] = field_means[r, c + lag] - (field_means[r, c] + field_means[r, c + 2 * lag]) * half

    level, floor, middle, total = 0.0, 0.0, 0.0, 0.0
    for c in range(columns):
        level += row_means[c]
    for r in range(high):
        for c in range(wide):
            floor += field_means[r, c]
    for x in range(width):
        total += row[x]
    for c in range(len(row_detail)):
        middle += row_detail[c]
    middle /= max(1, len(row_detail))
    row_spread, field_spread, rough, spread = 0.0, 0.0, 0.0, 0.0
    for c in range(len(row_detail)):
        row_spread += (row_detail[c] - middle) ** 2
    middle = 0.0
    for r in range(high):
        for c in range(field_detail.shape[1]):
            middle += field_detail[r, c]
    middle /= max(1, field_detail.size)
    for r in range(high):
        for c in range(field_detail.shape[1]):
            field_spread += (field_detail[r, c] - middle) ** 2
    total /= width
    for x in range(width):
        spread += (row[x] - total) ** 2
    for x in range(width - 1):
        rough += (row[x + 1] - row[x]) ** 2
    step = row.dtype.type(0)
    for x in range(width - 2):
        step = max(step, abs(row[x + 2] - row[x]))

    # The lowest and the highest few means, sorted by insertion.
    cut = columns // TAIL
    low, top = np.full(cut + 1, np.inf, row.dtype), np.full(cut + 1, -np.inf, row.dtype)
    for c in range(columns):
        value = row_means[c]
        if value < low[cut]:
            k = cut
            while k > 0 and low[k - 1] > value:
                low[k] = low[k - 1]
                k -= 1
            low[k] = value
        if value > top[cut]:
            k = cut
            while k > 0 and top[k - 1] < value:
                top[k] = top[k - 1]
                k -= 1
            top[k] = value
    return (
        level / max(1, columns),
        floor / max(1, field_means.size),
        math.sqrt(row_spread / max(1, len(row_detail))),
        math.sqrt(field_spread / max(1, field_detail.size)),
        rough / max(1, width - 1) * scale * scale,
        math.sqrt(spread / width) * scale,
        float(top[cut] - low[cut]),
        float(step) * scale,
    )


@jit
def sd_of_change(now: Floats, before: Floats) -> float:
    """Standard deviation of the difference of two images as vectors `[n]`, n > 0; a common change of light is none."""
    count = len(now)
    steps, total, square = np.empty(count, now.dtype), 0.0, 0.0
    for x in range(count):
        steps[x] = now[x] - before[x]
        total += steps[x]
    total /= count
    for x in range(count):
        square += (steps[x] - total) ** 2
    return math.sqrt(square / count)


@jit
def best_correlations(
    left: Floats,
    right: Floats,
    patch: int,
    reach: int,
    mirrored_reach: int,
    least: float,
    flat: float,
    soft: float,
    found: Floats,
) -> int:
    """Best correlations of those patches of the left row that have texture.

    Args:
        left, right: block means, `[n]`.
        patch: blocks of a patch; consecutive patches overlap by half.
        reach, mirrored_reach: largest disparity of a match, and of a mirrored match, blocks.
        least, flat: smallest standard deviation of a patch, in levels and as a ratio to the mean of the left row.
        soft: levels added to the standard deviation of the right patch.
        found: filled, `[3, patches]`: match to the left, to the right, and mirrored match on either side.

    Returns:
        Number of patches with texture.
    """
    count, half = len(right) - patch + 1, reach // 2
    share, middle, mean = 1 / math.sqrt(patch), 0.0, 0.0
    for x in range(len(left)):
        mean += left[x]
    for x in range(len(right)):
        middle += right[x]
    least = max(least, flat * mean / len(left))
    middle /= len(right)
    # Left patches have mean 0, so right ones may keep theirs; without the mean of the row sums stay small.
    theirs, sizes = np.empty(len(right), right.dtype), np.empty(count, right.dtype)
    for x in range(len(right)):
        theirs[x] = right[x] - middle
    for w in range(count):
        part = theirs[w : w + patch]
        total, square = right.dtype.type(0), right.dtype.type(0)
        for i in range(patch):
            total += part[i]
        total /= patch
        for i in range(patch):
            square += (part[i] - total) ** 2
        sizes[w] = 1 / (math.sqrt(square) + soft / share)
    ours = np.empty(patch, left.dtype)
    both = np.empty((2, count), right.dtype)
    shown = 0
    for start in range(0, len(left) - patch + 1, patch // 2):
        if start < half or start >= count - half:
            continue
        total, square = 0.0, 0.0
        for i in range(patch):
            total += left[start + i]
        total /= patch
        for i in range(patch):
            ours[i] = left[start + i] - total
            square += ours[i] ** 2
        size = math.sqrt(square)
        if not size * share > least:
            continue
        first, last = max(0, start - reach), min(count, start + reach + 1)
        # The compiler vectorises only loops that begin at 0.
        near = last - first
        scores, mirrored, weights = both[0, :near], both[1, :near], sizes[first:last]
        scores[:] = 0
        mirrored[:] = 0
        for i in range(patch):
            a, b, part = ours[i], ours[patch - 1 - i], theirs[first + i : last + i]
            for w in range(near):
                scores[w] += a * part[w]
            for w in range(near):
                mirrored[w] += b * part[w]
        best, wrong, turned = -1.0, -1.0, -1.0
        for w in range(near):
            score = scores[w] * weights[w] / size
            if abs(w + first - start) <= mirrored_reach:
                turned = max(turned, mirrored[w] * weights[w] / size)
            if w + first < start:
                best = max(best, score)
            elif w + first > start + 1:
                wrong = max(wrong, score)
        found[0, shown], found[1, shown], found[2, shown] = best, wrong, turned
        shown += 1
    return shown
