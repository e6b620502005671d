"""Compiled functions of the camera monitor: image statistics, change of an image, correlations of stereo patches."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[Any]

BLOCK, TAIL = 4, 50
"""Pixels of a block; the range of a row leaves out one of this many block means at either end."""

LAGS = (8, 4)
"""Blocks of the row, and of the subfield, over which a change of brightness counts as shading."""


@jit
def image_statistics(row: Floats, field: Floats, scale: float) -> tuple[Any, ...]:
    """Block means of an image, the same without shading, and the fields of `ImageStatistics`.

    Args:
        row, field: `[1, W]` and `[h, w]`; times `scale` they are levels of 255.

    Returns:
        Arrays `[1, W / 4]`, `[h / 4, w / 4]`, `[1, W / 4 - 2 lag]` and `[h / 4, w / 4 - 2 lag]`, and eight numbers.
    """
    means, blocks = block_means(row, 1, scale), block_means(field, BLOCK, scale)
    row_detail, field_detail = without_shading(means, LAGS[0]), without_shading(blocks, LAGS[1])
    rough, step, pixels = 0.0, row.dtype.type(0), row[0]
    for x in range(len(pixels) - 1):
        rough += (pixels[x + 1] - pixels[x]) ** 2
    for x in range(len(pixels) - 2):
        step = max(step, abs(pixels[x + 2] - pixels[x]))
    ordered, cut = np.sort(means[0]), means.size // TAIL
    return (
        means,
        blocks,
        row_detail,
        field_detail,
        means.sum() / max(1, means.size),
        blocks.sum() / max(1, blocks.size),
        deviation(row_detail),
        deviation(field_detail),
        rough / max(1, len(pixels) - 1) * scale**2,
        deviation(row) * scale,
        ordered[len(ordered) - 1 - cut] - ordered[cut],
        step * scale,
    )


@jit
def block_means(image: Floats, high: int, scale: float) -> Floats:
    """Means `[h / high, w / 4]` of blocks of an image `[h, w]`, times `scale`."""
    means = np.empty((image.shape[0] // high, image.shape[1] // BLOCK), image.dtype)
    for r in range(means.shape[0]):
        sums = image[high * r].copy()
        for k in range(1, high):
            sums += image[high * r + k]
        for c in range(means.shape[1]):
            x = BLOCK * c
            means[r, c] = (sums[x] + sums[x + 1] + sums[x + 2] + sums[x + 3]) * (scale / (BLOCK * high))
    return means


@jit
def without_shading(means: Floats, most: int) -> Floats:
    """Block means `[h, w]` less those `most` blocks to either side; of too few blocks, less their mean."""
    lag, half = min(most, (means.shape[1] - 1) // 4), means.dtype.type(0.5)
    if lag <= 0:
        return np.asarray(means - means.dtype.type(means.sum() / max(1, means.size)))
    return np.asarray(means[:, lag:-lag] - (means[:, : -2 * lag] + means[:, 2 * lag :]) * half)


@jit
def deviation(values: Floats) -> float:
    """Standard deviation; 0 of nothing."""
    total, square = values.sum() / max(1, values.size), 0.0
    for value in values.flat:
        square += (value - total) ** 2
    return math.sqrt(square / max(1, values.size))


@jit
def sd_of_change(now: Floats, before: Floats) -> float:
    """Standard deviation of the difference of two images; a common change of light is none."""
    return deviation(now - before)


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
    count, half, root, shown = len(right) - patch + 1, reach // 2, math.sqrt(patch), 0
    least = max(least, flat * left.mean())
    theirs, weights = right - right.mean(), np.empty(count, right.dtype)
    for w in range(count):
        weights[w] = 1 / (root * (theirs[w : w + patch].std() + soft))
    for start in range(0, len(left) - patch + 1, patch // 2):
        ours = left[start : start + patch] - left[start : start + patch].mean()
        size = math.sqrt((ours**2).sum())
        if not half <= start < count - half or not size > least * root:
            continue
        first, last = max(0, start - reach), min(count, start + reach + 1)
        scores, mirrored = np.zeros(last - first, right.dtype), np.zeros(last - first, right.dtype)
        for i in range(patch):
            a, b, part = ours[i], ours[patch - 1 - i], theirs[first + i : last + i]
            for w in range(last - first):  # the compiler vectorises only loops that begin at 0
                scores[w] += a * part[w]
                mirrored[w] += b * part[w]
        found[:, shown] = -1
        for w in range(first, last):
            score, turned = scores[w - first] * weights[w] / size, mirrored[w - first] * weights[w] / size
            if w < start:
                found[0, shown] = max(found[0, shown], score)
            elif w > start + 1:
                found[1, shown] = max(found[1, shown], score)
            if abs(w - start) <= mirrored_reach:
                found[2, shown] = max(found[2, shown], turned)
        shown += 1
    return shown
