"""Compiled passes over the pixels of a frame: comparison with the background, shadows, learning, sums of blobs."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from ndtorch.utils.jit import jit

Array = Any
"""An array in a compiled function."""

NUMBER, STATUS, BEGAN, SEEN, PLACE, VELOCITY, EXTENT, START, ANCHOR = 0, 1, 2, 3, 4, 6, 8, 10, 12
ANCHORED, DETECTIONS, ALONE, CONTRAST, AREA, COLOR, NETWORK, TRACK_COLUMNS = 14, 15, 16, 17, 18, 19, 22, 42
"""First columns of what is known of a track, see `ndtorch.foreground.tracker.Tracks`."""
TENTATIVE, MEASURED, PREDICTED, STATIONARY = range(4)
"""Statuses of tracks."""


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
def count_inside(labels: Array, boxes: Array, inside: Array) -> None:
    """Pixels of each label `[h, w]` but 0 in each box `[N, 4]` of left, top, right and bottom, added to `[N, L]`."""
    for n in range(boxes.shape[0]):
        left, top = max(0, round(boxes[n, 0])), max(0, round(boxes[n, 1]))
        right, bottom = round(boxes[n, 2]), round(boxes[n, 3])
        for y in range(top, min(bottom, labels.shape[0])):
            for x in range(left, min(right, labels.shape[1])):
                if labels[y, x] > 0:
                    inside[n, labels[y, x]] += 1


@jit
def name_blobs(components: Array, table: Array, shares: Array, labels: Array) -> None:
    """The blob of every pixel: that of its component in a table, or the nearest of those who share it.

    Args:
        components, labels: `[h, w]` int32.
        shares: of each who shares: the blob that is divided, the blob that is its part, column and row, width and
            height, `[N, 6]`.
    """
    for y in range(labels.shape[0]):
        for x in range(labels.shape[1]):
            label = table[components[y, x]]
            labels[y, x] = label
            least = np.inf
            for n in range(shares.shape[0] if label > 0 else 0):
                if shares[n, 0] == label:
                    across = (x + 0.5 - shares[n, 2]) / shares[n, 4]
                    along = (y + 0.5 - shares[n, 3]) / shares[n, 5]
                    if across * across + along * along < least:
                        least = across * across + along * along
                        labels[y, x] = int(shares[n, 1])


@jit
def sum_blobs(labels: Array, image: Array, distance: Array, sigma: Array, sums: Array) -> None:
    """Of each label: pixels, left, top, right and bottom, column and row of the centroid or of the pixel next to it,
    mean red, green, blue and contrast.

    Args:
        sums: become these, a row for each label without 0; its last column is for work, `[N, 12]`.
    """
    for n in range(sums.shape[0]):
        sums[n] = 0.0
        sums[n, 1], sums[n, 2] = labels.shape[1], labels.shape[0]
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
    middles = np.empty((sums.shape[0], 2))
    for n in range(sums.shape[0]):
        sums[n, 5:11] /= max(sums[n, 0], 1.0)
        middles[n] = sums[n, 5:7]
        sums[n, 11] = np.inf
    for y in range(labels.shape[0]):
        for x in range(labels.shape[1]):
            if labels[y, x] > 0:
                own, middle = sums[labels[y, x] - 1], middles[labels[y, x] - 1]
                away = (x - middle[0]) ** 2 + (y - middle[1]) ** 2
                if away < own[11]:
                    own[5], own[6], own[11] = x, y, away
    for n in range(sums.shape[0]):
        if max(abs(sums[n, 5] - middles[n, 0]), abs(sums[n, 6] - middles[n, 1])) <= 0.5:
            sums[n, 5:7] = middles[n]


@jit
def fill_costs(
    expected: Array,
    extent: Array,
    gate: Array,
    area: Array,
    box: Array,
    blob_area: Array,
    limits: tuple[float, float],
    cost: Array,
) -> None:
    """Distance of each track from the middle of each blob in gates, 1 and more of pairs that may not meet.

    Args:
        expected, extent: position and size of N tracks, `[N, 2]`; gate, area: theirs, `[N]`.
        box: of K blobs, `[K, 4]`; blob_area: `[K]`.
        limits: largest ratio of areas, and the overlap from which on a pair may meet all the same.
        cost: becomes that, `[N, K]`.
    """
    for n in range(cost.shape[0]):
        left, right = expected[n, 0] - extent[n, 0] / 2, expected[n, 0] + extent[n, 0] / 2
        top, bottom = expected[n, 1] - extent[n, 1] / 2, expected[n, 1] + extent[n, 1] / 2
        for k in range(cost.shape[1]):
            across = expected[n, 0] - (box[k, 0] + box[k, 2]) / 2
            along = expected[n, 1] - (box[k, 1] + box[k, 3]) / 2
            apart = sqrt(across * across + along * along) / max(gate[n], 1e-9)
            if max(area[n], blob_area[k]) > limits[0] * min(area[n], blob_area[k]):
                apart = np.inf
            width = max(0.0, min(right, box[k, 2]) - max(left, box[k, 0]))
            height = max(0.0, min(bottom, box[k, 3]) - max(top, box[k, 1]))
            smaller = min(extent[n, 0] * extent[n, 1], (box[k, 2] - box[k, 0]) * (box[k, 3] - box[k, 1]))
            overlap = width * height / max(smaller, 1e-12)
            cost[n, k] = min(apart, 1 - overlap / 2) if overlap > limits[1] else apart
            if blob_area[k] == 0:
                cost[n, k] = np.inf


@jit
def measure_tracks(
    rows: Array,
    expected: Array,
    box: Array,
    looks: Array,
    shared: Array,
    i: Array,
    j: Array,
    time: float,
    paces: tuple[float, float, float],
) -> None:
    """Take the assigned blobs into their tracks. Of a shared blob the size is remembered, not measured.

    Args:
        rows: of tracks, are updated; expected: their positions, `[N, 2]`.
        box, looks, shared: of blobs: box, `[K, 4]`, area, contrast and color, `[K, 5]`, and whether they are shared.
        i, j: tracks and their blobs.
        paces: time constants of velocity and size, and share of the innovation in a shared blob.
    """
    for n in range(i.shape[0]):
        own, blob, part = rows[i[n]], j[n], shared[j[n]]
        gap = time - own[SEEN]
        own[SEEN] = time
        # Of a young track the velocity is the mean of all steps so far.
        pace = max(gap / (paces[0] + gap), 1 / max(own[DETECTIONS], 1.0))
        own[DETECTIONS] += 1
        keep = gap / (paces[1] + gap)
        for k in range(2):
            step = (box[blob, k] + box[blob, 2 + k]) / 2 - expected[i[n], k]
            step *= paces[2] if part else 1.0
            own[VELOCITY + k] += pace / gap * step
            own[PLACE + k] = expected[i[n], k] + step
            if not part:
                own[EXTENT + k] += keep * (box[blob, 2 + k] - box[blob, k] - own[EXTENT + k])
        own[CONTRAST] += (looks[blob, 1] - own[CONTRAST]) / own[DETECTIONS]
        if not part:
            own[ALONE] += 1
            own[AREA] = looks[blob, 0]
            for k in range(3):
                own[COLOR + k] += keep * (looks[blob, 2 + k] - own[COLOR + k])
        if own[STATUS] != TENTATIVE:
            own[STATUS] = PREDICTED if part else MEASURED


@jit
def confirm_tracks(
    rows: Array, time: float, ready: bool, limits: tuple[float, float, float, float, float, float]
) -> None:
    """A tentative track is confirmed by age, travel and contrast; an object that does not move on is stationary.

    Args:
        rows: of tracks, are updated.
        ready: whether tracks may be confirmed.
        limits: smallest travel in sizes and in heights, contrast and age; seconds after which an object is stationary,
            and the sizes by which it moves on.
    """
    for n in range(rows.shape[0]):
        own = rows[n]
        size = (own[EXTENT] + own[EXTENT + 1]) / 2
        net = sqrt((own[PLACE] - own[START]) ** 2 + (own[PLACE + 1] - own[START + 1]) ** 2)
        if sqrt((own[PLACE] - own[ANCHOR]) ** 2 + (own[PLACE + 1] - own[ANCHOR + 1]) ** 2) > limits[5] * size:
            own[ANCHOR], own[ANCHOR + 1], own[ANCHORED] = own[PLACE], own[PLACE + 1], time
        enough = max(limits[0] * size, limits[1]) if limits[0] > 0 else 0.0
        proven = net >= enough and own[CONTRAST] >= limits[2] and time - own[BEGAN] >= limits[3]
        if own[STATUS] == TENTATIVE:
            if ready and proven and own[SEEN] == time:
                own[STATUS] = MEASURED
        elif own[STATUS] != PREDICTED and time - own[ANCHORED] >= limits[4]:
            own[STATUS] = STATIONARY


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
