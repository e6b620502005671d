"""Patches of one row of block means looked for in another; see `robot.agreement`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[Any]


@jit
def partners(
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
    """Best correlations of the patches of the left row that show something.

    Args:
        left, right: block means, `[n]`.
        patch: blocks of a patch; every half of one begins another.
        reach, mirrored_reach: how far partners, and mirrored ones, may lie, blocks.
        least, flat: standard deviation that a patch must have, in levels and as a share of the mean of the left row.
        soft: added to the standard deviation of what a patch is compared with.
        found: `[3, patches]`: with a partner to the left, to the right, and anywhere when mirrored; filled.

    Returns:
        How many patches show something.
    """
    count, half = len(right) - patch + 1, reach // 2
    share, middle, mean = 1 / math.sqrt(patch), 0.0, 0.0
    for x in range(len(left)):
        mean += left[x]
    for x in range(len(right)):
        middle += right[x]
    least = max(least, flat * mean / len(left))
    middle /= len(right)
    # Patches have no mean, so what they are compared with may keep its own; without that of the row sums stay small.
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
        # Loops from 0 over parts: the compiler makes wide operations of those only.
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
