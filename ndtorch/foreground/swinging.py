"""Swinging: what passes covers a pixel from one side and leaves it to the other; what swings leaves as it came.

A leaf near the lens covers part of the picture again and again. Where such regions reach beyond the picture, the noise
is learned under objects too.
"""

from __future__ import annotations

import math

import numpy as np

from ndtorch.foreground.arrays import Array, Bytes
from ndtorch.foreground.morphology import any_nonzero
from ndtorch.utils.jit import jit

STRIDE = 2
"""Squares of so many rows and columns are one pixel here."""
REACH = 2
"""The covered side is that of most foreground within so many pixels."""
MIN_VISIT_S = 0.2
"""What covers a pixel for less than this is noise."""
SETTLING_S = 2.0
"""The first seconds of a scene do not count."""
FULL_TURN = 256
"""Directions are in bytes."""
VISIT, MOST = 16, 240
"""What one visit counts, and the largest count. A sixteenth of it is forgotten every `EVERY_S`."""
EVERY_S = 1.0
"""The regions are found once in so many seconds."""
MIN_VISITS = 0.85
"""Visits of this kind in a region, in the mean of the pixels around, and at least twice as many as the others."""
WINDOW_PX, GAP_PX, MARGIN_PX = 3, 3, 7
"""Sides of the squares of that mean, of gaps in a region, and of what belongs to it around it."""
MIN_AREA_RATIO = 0.02
"""A region is at least this share of the picture."""

DIRECTION, STEPS, RETURNED, PASSED, SWINGING = range(5)
"""Planes of the state, `[5, h / 2, w / 2]` uint8: the side from which a pixel was covered, steps since then (0: it is
free), visits that left as they came, those that passed, and 1 in the regions that swing."""


def start(height: int, width: int) -> Bytes:
    """The state of an image in which nothing has swung yet."""
    return np.zeros((5, -(-height // STRIDE), -(-width // STRIDE)), np.uint8)


def update_swinging(state: Bytes, mask: Bytes, frames: int, dt: float) -> None:
    """Count visits of a foreground mask `[h, w]`, and mark what swings.

    Args:
        state: updated.
        frames: steps since the scene began; dt: seconds of a step.
    """
    time = frames * dt
    count_visits(mask, state, max(1, math.ceil(MIN_VISIT_S / dt - 1e-6)) if time >= SETTLING_S else FULL_TURN)
    if int(time / EVERY_S) > int((time - dt) / EVERY_S):
        find_regions(state)


def find_regions(state: Bytes) -> None:
    """Mark the regions that swing, and forget a part."""
    import cv2

    returned, passed = (cv2.blur(state[n], (WINDOW_PX, WINDOW_PX)) for n in (RETURNED, PASSED))
    marks = ((returned >= MIN_VISITS * VISIT) & (returned >> 1 >= passed)).astype(np.uint8)
    state[SWINGING] = 0
    if marks.any():
        marks = cv2.dilate(marks, np.ones((GAP_PX, GAP_PX), np.uint8))
        _, labels, boxes, _ = cv2.connectedComponentsWithStats(marks)
        left, top, wide, tall, area = boxes.T
        beyond = (left == 0) | (top == 0) | (left + wide == marks.shape[1]) | (top + tall == marks.shape[0])
        keep = beyond & (area >= MIN_AREA_RATIO * marks.size)
        keep[0] = False
        state[SWINGING] = cv2.dilate(keep[labels].astype(np.uint8), np.ones((MARGIN_PX, MARGIN_PX), np.uint8))
    for plane in state[RETURNED], state[PASSED]:
        plane -= (plane + np.uint8(VISIT - 1)) // np.uint8(VISIT)


@jit
def count_visits(mask: Array, state: Array, least: int) -> None:
    """Count visits that end, and the steps of those that go on.

    Args:
        mask: 1 for foreground, `[h, w]` uint8.
        state: updated.
        least: steps of a visit that counts.
    """
    direction, steps, visits = state[DIRECTION], state[STEPS], (state[RETURNED], state[PASSED])
    height, width = steps.shape
    now, both = np.empty((height, width), np.uint8), np.empty((height + 2 * REACH, width + 2 * REACH), np.uint8)
    line = np.zeros(STRIDE * width, np.uint8)
    for y in range(height):
        add_rows(mask[STRIDE * y], mask[min(STRIDE * y + 1, mask.shape[0] - 1)], line)
        row = both[y + REACH]
        halve(line, steps[y], now[y], row[REACH : REACH + width])
        row[:REACH], row[REACH + width :] = row[REACH], row[REACH + width - 1]
    both[:REACH], both[REACH + height :] = both[REACH], both[REACH + height - 1]
    for y in range(height):
        row = both[y + REACH]
        if not any_nonzero(row):
            continue
        for x in range(width):
            if row[x + REACH] != 1:
                continue
            side = covered_side(both, y, x)
            if now[y, x]:
                direction[y, x] = side
            elif steps[y, x] >= least:
                turn = abs(side - np.int64(direction[y, x]))
                turn = min(turn, FULL_TURN - turn)
                kind = 0 if 6 * turn < FULL_TURN else 1
                if kind == 0 or 3 * turn > FULL_TURN:
                    visits[kind][y, x] = min(np.int64(visits[kind][y, x]) + VISIT, MOST)
        count_steps(now[y], steps[y])


@jit
def add_rows(upper: Array, lower: Array, line: Array) -> None:
    for x in range(upper.shape[0]):
        line[x] = upper[x] | lower[x]


@jit
def halve(line: Array, steps: Array, now: Array, both: Array) -> None:
    """Whether either of two pixels is foreground, `[w]`, plus whether it was."""
    for x in range(now.shape[0]):
        now[x] = line[2 * x] | line[2 * x + 1]
        both[x] = now[x] + np.uint8(steps[x] > 0)


@jit
def count_steps(now: Array, steps: Array) -> None:
    for x in range(now.shape[0]):
        steps[x] = (steps[x] + np.uint8(steps[x] < 255)) * now[x]


@jit
def covered_side(both: Array, y: int, x: int) -> int:
    """Direction of most foreground around a pixel, 0 to 255; its row and column begin `REACH` later in `both`."""
    down = across = np.int64(0)
    for j in range(2 * REACH + 1):
        for i in range(2 * REACH + 1):
            amount = np.int64(both[y + j, x + i])
            down, across = down + (j - REACH) * amount, across + (i - REACH) * amount
    return round(math.atan2(down, across) * FULL_TURN / (2 * math.pi)) % FULL_TURN
