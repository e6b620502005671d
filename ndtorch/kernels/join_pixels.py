"""Connected regions of a mask, what they enclose filled, run by run."""

from __future__ import annotations

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def join_pixels(mask: Array, smallest: float, labels: Array, boxes: Array) -> int:
    """See `ndtorch.binding.tracking.regions.regions_of`.

    Args:
        mask: what is joined where it is not 0, `[h, w]` uint8.
        smallest: pixels of the smallest region.
        labels: become the number of the region of every pixel, `[h, w]` int32.
        boxes: of every region become top, left, bottom, right and pixels, `[N, 5]`, with room for all.

    Returns:
        How many there are. They are counted by where they begin, in pairs of rows and columns, as OpenCV does.
    """
    height, width = mask.shape
    # Runs of equal pixels, row after row: row, begin, end, and 1 where they stand out. What lies outside the picture is
    # number 0. Each is owned by the first of those that it hangs together with.
    runs, owner = np.empty((height * width + 1, 4), np.int32), np.empty(height * width + 1, np.int32)
    owner[0], count, k = 0, 1, 1
    for y in range(height):
        row, x = count, 0
        while x < width:
            # Mostly nothing is there, and goes on.
            if x and not runs[count - 1, 3] and x + 8 <= width and not any_of(mask[y], x):
                x += 8
                runs[count - 1, 2] = x
                continue
            here = 1 if mask[y, x] else 0
            if x == 0 or here != runs[count - 1, 3]:
                runs[count, 0], runs[count, 1], runs[count, 3], owner[count] = y, x, here, count
                count += 1
            x += 1
            runs[count - 1, 2] = x
        for n in range(row, count):
            start, end, here = runs[n, 1], runs[n, 2], runs[n, 3]
            # Pixels that stand out also hang together by their corners. Above the first row is the outside.
            while y and k < row - 1 and runs[k, 2] <= start - here:
                k += 1
            j = k
            while j < row and y and runs[j, 1] < end + here:
                if runs[j, 3] == here:
                    join(owner, n, j)
                j += 1
            if not here and (y == 0 or y == height - 1 or start == 0 or end == width):
                join(owner, n, 0)
        k = row
    for n in range(1, count):
        owner[n] = owner[owner[n]]
    for n in range(1, count):
        # What the outside does not reach is enclosed by both its neighbors.
        if not runs[n, 3] and owner[n]:
            join(owner, n - 1, n)
            join(owner, n, n + 1)
    found, slots, first = 0, np.full(count, -1, np.int32), np.empty(count, np.int64)
    for n in range(1, count):
        owner[n] = owner[owner[n]]
        r, y, start, end = owner[n], runs[n, 0], runs[n, 1], runs[n, 2]
        if r == 0:
            continue
        key = (y // 2) * width + start // 2
        if slots[r] < 0:
            slots[r], first[found] = found, key
            boxes[found, 0], boxes[found, 1], boxes[found, 3], boxes[found, 4] = y, start, end, 0
            found += 1
        k = slots[r]
        first[k] = min(first[k], key)
        boxes[k, 1], boxes[k, 3] = min(boxes[k, 1], start), max(boxes[k, 3], end)
        boxes[k, 2], boxes[k, 4] = y + 1, boxes[k, 4] + end - start
    # Those that are large enough, in order.
    kept, number, large = 0, np.zeros(found, np.int32), np.empty((found, 5), np.int64)
    for k in range(found):
        if boxes[k, 4] < smallest:
            continue
        number[k] = 1
        for n in range(k):
            if number[n] and first[n] < first[k]:
                number[k] += 1
            elif number[n]:
                number[n] += 1
        kept += 1
    for k in range(found):
        for side in range(5 if number[k] else 0):
            large[number[k] - 1, side] = boxes[k, side]
    for k in range(kept):
        for side in range(5):
            boxes[k, side] = large[k, side]
    labels[:] = 0
    for n in range(1, count):
        name = number[slots[owner[n]]] if owner[n] else 0
        if not name:
            continue
        for x in range(runs[n, 1], runs[n, 2]):
            labels[runs[n, 0], x] = name
    return kept


@jit
def any_of(row: Array, x: int) -> int:
    """Whether one of eight pixels stands out."""
    first = row[x] | row[x + 1] | row[x + 2] | row[x + 3]
    return int(first | row[x + 4] | row[x + 5] | row[x + 6] | row[x + 7])


@jit
def join(owner: Array, one: int, other: int) -> None:
    """Two runs hang together."""
    while owner[one] != one:
        owner[one] = owner[owner[one]]
        one = owner[one]
    while owner[other] != other:
        owner[other] = owner[owner[other]]
        other = owner[other]
    owner[max(one, other)] = min(one, other)
