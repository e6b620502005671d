"""Compiled passes over labels of blobs: connected components, splitting, overlaps and shares."""

from __future__ import annotations

from math import ceil, floor

import numpy as np

from ndtorch.foreground.arrays import Array
from ndtorch.foreground.morphology import WORD, any_nonzero, closing, inside_row, mirrored, pack, row_of
from ndtorch.utils.jit import jit


@jit
def label_components(mask: Array, gap: int, smallest: float, labels: Array, boxes: Array) -> int:
    """See `ndtorch.tracking.blobs.connected_components`; what a component encloses is filled.

    Args:
        mask: what is joined, `[h, w]` bool.
        gap: pixels of the largest gap that is closed.
        smallest: pixels of the smallest component.
        labels: become the number of the component of every pixel, `[h, w]` int32.
        boxes: of every component become top, left, bottom, right and pixels, `[N, 5]`, with room for all.

    Returns:
        How many there are. They are counted by where they begin, in pairs of rows and columns, as OpenCV does.
    """
    height, width = mask.shape
    margin = gap + 1
    inside = inside_row(width, margin)
    line = inside.shape[0]
    bits = np.zeros(line * (height + 2 * margin), np.uint64)
    for y in range(height):
        pack(mask[y], row_of(bits, y, line, margin))
    if gap:
        closing(bits, gap + 1, inside, margin, (np.empty_like(bits), np.empty_like(bits)))
    labels[:] = 0
    # Runs of equal pixels, row after row: row, begin, end, and 1 for foreground. What lies outside the image is
    # number 0. Each is owned by the first of those that it hangs together with.
    runs, owner = np.empty((height * width + 1, 4), np.int32), np.empty(height * width + 1, np.int32)
    owner[0], count, k = 0, 1, 1
    for y in range(height):
        row, before = count, -1
        for at in range(0, width, WORD):
            word, end = bits[(y + margin) * line + at // WORD], min(at + WORD, width)
            x = at if word or before else end
            while x < end:
                some = int(np.int64(word >> np.uint64(x - at)) & 255)
                # Mostly what is there goes on.
                if x % 8 == 0 and some == 255 * before:
                    x += 8
                    continue
                if some & 1 != before:
                    runs[count, 0], runs[count, 1], runs[count, 3], owner[count] = y, x, some & 1, count
                    if before >= 0:
                        runs[count - 1, 2] = x
                    count, before = count + 1, some & 1
                x += 1
        runs[count - 1, 2] = width
        for n in range(row, count):
            start, end, here = runs[n, 1], runs[n, 2], runs[n, 3]
            # Pixels that stand out also hang together by their corners. Above the first row is the outside.
            while y and k < row - 1 and runs[k, 2] <= start - here:
                k += 1
            j = k
            while j < row and y and runs[j, 1] < end + here:
                if runs[j, 3] == here:
                    join_runs(owner, n, j)
                j += 1
            if not here and (y == 0 or y == height - 1 or start == 0 or end == width):
                join_runs(owner, n, 0)
        k = row
    for n in range(1, count):
        owner[n] = owner[owner[n]]
    for n in range(1, count):
        # What the outside does not reach is enclosed by both its neighbors.
        if not runs[n, 3] and owner[n]:
            join_runs(owner, n - 1, n)
            join_runs(owner, n, n + 1)
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
    for n in range(1, count):
        name = number[slots[owner[n]]] if owner[n] else 0
        if not name:
            continue
        for x in range(runs[n, 1], runs[n, 2]):
            labels[runs[n, 0], x] = name
    return kept


@jit
def join_runs(owner: Array, one: int, other: int) -> None:
    """Two runs hang together."""
    while owner[one] != one:
        owner[one] = owner[owner[one]]
        one = owner[one]
    while owner[other] != other:
        owner[other] = owner[owner[other]]
        other = owner[other]
    owner[max(one, other)] = min(one, other)


@jit
def mark_still(
    mask: Array, labels: Array, moving: Array, static_time: Array, least: float, free: Array, still: Array
) -> int:
    """Foreground that is of no moving object, and that which is static too; returns the pixels of the second.

    Args:
        mask: foreground; free, still: become 1 there, `[h, w]` bool.
        labels: numbers of tracks, plus one, and moving: 1 for those that move.
        static_time: seconds without motion, and least: seconds after which a pixel is static.
    """
    count, shortest = 0, static_time.dtype.type(least)
    for y in range(mask.shape[0]):
        free[y], still[y] = False, False
        for x in range(mask.shape[1] if any_nonzero(mask[y]) else 0):
            if mask[y, x] and not moving[labels[y, x]]:
                free[y, x] = True
                if static_time[y, x] >= shortest:
                    still[y, x] = True
                    count += 1
    return count


@jit
def find_ghosts(labels: Array, mask: Array, grey: Array, background: Array, ghost: Array) -> None:
    """See `ndtorch.tracking.blobs.ghosts`.

    Args:
        labels: number of the component of every pixel from 1, `[h, w]` int32.
        mask: foreground, `[h, w]` bool; grey: the image, `[h, w]`, and background: `[3, h, w]`.
        ghost: becomes whether each component is a ghost, `[components + 1]` bool.
    """
    height, width = labels.shape
    count, ground = ghost.shape[0], np.empty((height, width), grey.dtype)
    for y in range(height):
        for x in range(width):
            ground[y, x] = (background[0, y, x] + background[1, y, x] + background[2, y, x]) / 3
    whole, outer, edges = np.zeros(count, np.int64), np.zeros(count, np.int64), np.zeros((2, count))
    ours, theirs = edge_sizes(grey), edge_sizes(ground)
    for y in range(height):
        for x in range(width if any_nonzero(labels[y]) else 0):
            r = labels[y, x]
            if r == 0:
                continue
            rows, columns = slice(max(y - 1, 0), y + 2), slice(max(x - 1, 0), x + 2)
            if labels[rows, columns].all():
                continue
            whole[r] += 1
            # The side towards what moves says nothing: that may be the object itself.
            if not mask[rows, columns].all():
                outer[r] += 1
                edges[0, r] += ours[rows, columns].max()
                edges[1, r] += theirs[rows, columns].max()
    for r in range(1, count):
        ghost[r] = 2 * outer[r] > whole[r] and edges[1, r] > edges[0, r]


@jit
def edge_sizes(image: Array) -> Array:
    """Magnitudes of the Sobel filter across plus those along, `[h, w]`; edges are mirrored."""
    height, width = image.shape
    size, sums, steps = np.empty_like(image), np.empty(width + 2, image.dtype), np.empty(width + 2, image.dtype)
    for y in range(height):
        upper, middle, lower = image[mirrored(y - 1, height)], image[y], image[mirrored(y + 1, height)]
        for x in range(width):
            sums[x + 1], steps[x + 1] = upper[x] + 2 * middle[x] + lower[x], lower[x] - upper[x]
        for line in (sums, steps):
            line[0], line[width + 1] = line[1 + mirrored(-1, width)], line[1 + mirrored(width, width)]
        for x in range(width):
            size[y, x] = abs(sums[x + 2] - sums[x]) + abs(steps[x] + 2 * steps[x + 1] + steps[x + 2])
    return size


@jit
def mark_cast(labels: Array, boxes: Array, mask: Array, narrow: Array, columns: int, found: Array) -> bool:
    """See `ndtorch.tracking.blobs.cast_shadows`; whether there are any.

    Args:
        labels, boxes: of the blobs.
        columns: that are summed up.
        found: becomes 1 in narrow shadows that are cast, `[h, w]` bool.
    """
    some, half = False, columns // 2
    for r in range(boxes.shape[0]):
        top, left, bottom, right = boxes[r, 0], boxes[r, 1], boxes[r, 2], boxes[r, 3]
        # By how much the narrow shadow of a column is more than half of it.
        excess, cast = np.zeros(right - left + 2 * half, np.int64), np.zeros(right - left, np.bool_)
        for y in range(top, bottom):
            for x in range(left, right):
                if labels[y, x] == r + 1 and mask[y, x]:
                    excess[x - left + half] += 1 if narrow[y, x] else -1
        for x in range(right - left):
            cast[x] = excess[x : x + 2 * half + 1].sum() > 0
        if not cast.any() or cast.all():
            continue
        for y in range(top, bottom):
            for x in range(left, right):
                if cast[x - left] and labels[y, x] == r + 1 and mask[y, x] and narrow[y, x]:
                    found[y, x] = some = True
    return some


@jit
def split_components(labels: Array, boxes: Array, count: int, notch: float, least: float, share: float) -> int:
    """See `ndtorch.tracking.blobs.split_blobs`.

    Args:
        labels: number of the blob of every pixel from 1, `[h, w]`; changed where one is cut.
        boxes: top, left, bottom, right and pixels of each, `[M, 5]`, with room for those cut off.
        count: how many there are.
        notch, least: as of `split_blobs`.
        share: smallest share of a blob that is cut off.

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
        at = narrowest_column(counts, max(1, (bottom - top) // 8), notch, max(least, share * boxes[r, 4]))
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
def narrowest_column(counts: Array, width: int, notch: float, least: float) -> int:
    """Where a blob with so many pixels a column `[n]` is cut, 0 if nowhere: between two peaks, where the smoothed count
    is below `notch` of the lower peak and at least `least` pixels remain on both sides."""
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


@jit
def rename(labels: Array, names: Array, renamed: Array) -> None:
    """New names `[n]` of labels `[h, w]`; 0 stays 0."""
    for y in range(labels.shape[0]):
        renamed[y] = 0
        for x in range(labels.shape[1] if any_nonzero(labels[y]) else 0):
            renamed[y, x] = names[labels[y, x]]


@jit
def overlaps(labels: Array, boxes: Array, inside: Array) -> None:
    """Adds the pixels of each of R blobs in each of K boxes.

    Args:
        labels: number of the blob of every pixel from 1, 0 where none is, `[h, w]` int32.
        boxes: top, left, bottom and right of each, pixels, `[K, 4]` float64; what is partly inside counts.
        inside: `[K, R]`.
    """
    height, width = labels.shape
    for k in range(boxes.shape[0]):
        top, left = max(0, floor(boxes[k, 0])), max(0, floor(boxes[k, 1]))
        bottom, right = min(height, ceil(boxes[k, 2])), min(width, ceil(boxes[k, 3]))
        for y in range(top, bottom):
            for x in range(left, right):
                number = labels[y, x]
                if number > 0:
                    inside[k, number - 1] += 1


@jit
def label_share(labels: Array, marked: Array, counts: Array, areas: Array) -> None:
    """Adds the marks, 0 or 1, and the number of the pixels `[h, w]` of every label, `[N]`."""
    some, rest = 0, 0
    for y in range(labels.shape[0]):
        if not any_nonzero(labels[y]):
            some += count_of(marked[y])
            rest += labels.shape[1]
            continue
        for x in range(labels.shape[1]):
            number = labels[y, x]
            # Most pixels are in none: to add all those to one place in memory takes several times as long.
            if number == 0:
                some += marked[y, x]
                rest += 1
                continue
            counts[number] += marked[y, x]
            areas[number] += 1
    counts[0] += some
    areas[0] += rest


@jit
def count_of(marked: Array) -> int:
    """How many of a row are marked."""
    count = np.int32(0)
    for x in range(marked.shape[0]):
        count += np.int32(marked[x])
    return int(count)
