"""Regions cut where they are narrow."""

from __future__ import annotations

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def part_regions(labels: Array, boxes: Array, count: int, notch: float, least: float, share: float) -> int:
    """See `ndtorch.binding.tracking.regions.parted`.

    Args:
        labels: number of the region of every pixel from 1, `[h, w]`; changed where one is cut.
        boxes: top, left, bottom, right and pixels of each, `[M, 5]`, with room for those cut off.
        count: how many there are.
        notch, least: as of `parted`.
        share: smallest share of a region that is cut off.

    Returns:
        How many there are then.
    """
    todo, waiting = np.empty(boxes.shape[0] + 1, np.int64), 0
    for r in range(count):
        if boxes[r, 4] >= 2 * least:
            todo[waiting] = r
            waiting += 1
    while waiting:
        waiting -= 1
        r = todo[waiting]
        top, left, bottom, right = boxes[r, 0], boxes[r, 1], boxes[r, 2], boxes[r, 3]
        counts = np.zeros(right - left, np.int64)
        for y in range(top, bottom):
            for x in range(left, right):
                if labels[y, x] == r + 1:
                    counts[x - left] += 1
        at = narrowest(counts, max(1, (bottom - top) // 8), notch, max(least, share * boxes[r, 4]))
        if at == 0:
            continue
        for half in range(2):
            name = count if half else r
            start, end = (left + at, right) if half else (left, left + at)
            boxes[name, 0], boxes[name, 1], boxes[name, 2], boxes[name, 3] = bottom, end, 0, 0
            boxes[name, 4] = 0
            for y in range(top, bottom):
                for x in range(start, end):
                    if labels[y, x] == r + 1:
                        labels[y, x] = name + 1
                        boxes[name, 0], boxes[name, 1] = min(boxes[name, 0], y), min(boxes[name, 1], x)
                        boxes[name, 2], boxes[name, 3] = max(boxes[name, 2], y + 1), max(boxes[name, 3], x + 1)
                        boxes[name, 4] += 1
            todo[waiting] = name
            waiting += 1
        count += 1
    return count


@jit
def narrowest(counts: Array, width: int, notch: float, least: float) -> int:
    """`narrow` of a profile `[n]`."""
    length = counts.shape[0]
    reach = min(width, length - 1) // 2
    sums, after = np.zeros(length, np.int64), np.zeros(length, np.int64)
    whole = 0
    for x in range(length):
        whole += counts[x]
        for k in range(max(0, x - reach), min(length, x + reach + 1)):
            sums[x] += counts[k]
    highest = 0
    for x in range(length - 1, -1, -1):
        highest = max(highest, sums[x])
        after[x] = highest
    depth, lowest, one = np.ones(length), 1.0, 0
    highest = 0
    for x in range(length):
        highest = max(highest, sums[x])
        if one >= least and whole - counts[x] - one >= least:
            depth[x] = sums[x] / max(min(highest, after[x]), 2 * reach + 1)
        lowest = min(lowest, depth[x])
        one += counts[x]
    found = 0
    for x in range(length):
        if depth[x] <= lowest + 1e-9:
            found += 1
    # Of several the two in the middle; of those the one that leaves halves more alike.
    seen, best, at, one, left = 0, whole + 1, 0, 0, 0
    for x in range(length):
        if depth[x] <= lowest + 1e-9:
            uneven = abs(2 * one + counts[x] - whole)
            if seen in ((found - 1) // 2, found // 2) and uneven < best:
                best, at, left = uneven, x, one
            seen += 1
        one += counts[x]
    if depth[at] >= notch:
        return 0
    return at if left >= whole - counts[at] - left else at + 1
