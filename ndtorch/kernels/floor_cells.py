"""Which cells look like floor that moves past, and what floor looks like."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ndtorch.utils.jit import jit

Array = Any


@jit
def floor_cells(
    cells: Array,
    driven: tuple[float, float],
    level: Array,
    noise: float,
    age: float,
    flow: Array,
    profile: Array,
    numbers: tuple[float, ...],
    new_level: Array,
    worth: tuple[float, float],
    evidence: Array,
) -> float:
    """`floor_step` of one car.

    Args:
        cells: `[4, bands, blocks]`, or `[2, bands, blocks]` as `evidence`.
        driven: speed and curvature.
        level, noise, age: of `FloorState` before; `new_level` after, `[bands]`; `age` is that of this step.
        flow, profile: of `FloorConstants`, `[bands]`.
        numbers: the rest of `FloorConstants`, in order.
        worth: evidence of something at the end of what is seen free, and of floor.
        evidence: that every cell gives.

    Returns:
        The noise after.
    """
    yaw, saturation, least, tolerance, clear, standing, learns, learn_share, share = numbers[:9]
    moving, still, noise_share, upright, least_agreed = numbers[9:14]
    eyes, bands, blocks = cells.shape
    kind = cells.dtype.type
    speed, turning = abs(kind(driven[0])), kind(driven[1]) * kind(yaw)
    learning = age <= learns
    shape, known, gained = np.empty(bands, cells.dtype), np.empty(bands, np.bool_), np.empty(bands, cells.dtype)
    for b in range(bands):
        passing = kind(math.sqrt(flow[b] + turning * turning)) * speed
        shape[b] = -math.expm1(passing * kind(saturation))
        gained[b] = kind(0)
        known[b] = level[b] * shape[b] > kind(noise) * kind(clear) and not learning
    excess = np.zeros((bands, blocks), cells.dtype)
    floor = np.zeros((bands, blocks), np.bool_)
    # As `agree`.
    one, seen_by_both = 0, 0
    for eye in range(2, eyes):
        for b in range(bands):
            for k in range(blocks):
                one += cells[eye, b, k] > 0
                seen_by_both += cells[eye, b, k] >= 0
    trusted = one > 0 and kind(one) >= kind(least_agreed) * kind(seen_by_both)
    for eye in range(2):
        mistaken = False
        for b in range(bands):
            expected = max(level[b] * shape[b], kind(least))
            for k in range(blocks):
                if known[b]:
                    excess[b, k] = kind(math.log(max(cells[eye, b, k], kind(least)) / expected))
                    floor[b, k] = abs(excess[b, k]) < kind(tolerance)
                    mistaken = mistaken or (eyes == 4 and not floor[b, k] and cells[eye + 2, b, k] > 0)
        beside = bands
        for k in range(blocks - 1, -1, -1):
            reached, end = True, bands
            # As `stands`; of these cells only the nearest matters, since nothing behind it is reached.
            foot, none, b = bands, 0, bands - 1
            while trusted and b >= 0 and cells[eye + 2, b, k] <= 0:
                if cells[eye + 2, b, k] == 0:
                    none += 1
                    foot = b if kind(none) >= kind(upright) else foot
                b -= 1
            for b in range(bands):
                both = cells[eye + 2, b, k] if eyes == 4 else kind(0)
                looks = (floor[b, k] and b != foot) or (known[b] and both > 0)
                goes_on = looks or (mistaken and both < 0)
                seen = reached and looks and not (trusted and both < 0 and b >= beside)
                ends = reached and known[b] and not goes_on
                end = b if ends else end
                evidence[eye, b, k] = kind(worth[0]) if ends else -kind(worth[1]) if seen else kind(0)
                if seen and floor[b, k]:
                    gained[b] += excess[b, k]
                reached = reached and goes_on
            beside = end
    for b in range(bands):
        new_level[b] = level[b] * kind(math.exp(gained[b] * kind(share)))
    if learning:
        for b in range(bands):
            new_level[b] = level[b]
        if age > standing and speed > kind(moving):
            learn(cells, shape, level, profile, kind(moving), kind(learn_share), new_level)
    if speed < kind(still):
        values = np.empty(2 * bands * blocks, cells.dtype)
        for k in range(values.size):
            values[k] = cells[k // (bands * blocks), k // blocks % bands, k % blocks]
        middle = lower_median(values)
        return float(kind(noise) + kind(noise_share) * (middle - kind(noise)))
    return noise


@jit(exact=True)
def learn(
    cells: Array, shape: Array, level: Array, profile: Array, moving: float, share: float, new_level: Array
) -> None:
    """At the start most of the nearest cells are floor: their median is its level."""
    near = max(1, cells.shape[1] * 2 // 5)
    blocks = cells.shape[2]
    steady = np.empty(2 * near * blocks, cells.dtype)
    for k in range(len(steady)):
        b = k // blocks % near
        steady[k] = cells[k // (near * blocks), b, k % blocks] / max(shape[b], moving)
    middle = lower_median(steady)
    for b in range(len(level)):
        guess = middle * profile[b]
        new_level[b] = level[b] + share * (guess - level[b]) if level[b] > 0 else guess


@jit(exact=True)
def lower_median(values: Array) -> float:
    """As `torch.median`; the values, of which there are few, are put in order."""
    for k in range(1, len(values)):
        value, place = values[k], k
        while place and values[place - 1] > value:
            values[place] = values[place - 1]
            place -= 1
        values[place] = value
    middle: float = values[(len(values) - 1) // 2]
    return middle
