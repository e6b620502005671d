"""One update of the windows that follow objects over a grid of fields."""

from __future__ import annotations

from math import exp, sqrt

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.window_numbers import WindowNumbers
from ndtorch.utils.jit import jit


@jit
def windows_update(
    low: Array,
    peak: Array,
    place: Array,
    velocity: Array,
    opened: Array,
    age: Array,
    unseen: Array,
    mean: Array,
    covariance: Array,
    light_mean: Array,
    light: Array,
    p: WindowNumbers,
    wrap: bool,
) -> None:
    """`windows_step` of one trial, in place.

    Args:
        low: signals `[R, C, 10]`.
        peak: `[1]`; like it the other arrays are those of `WindowState`, and become those after the update.
        p: constants.
        wrap: whether the scene is a torus.
    """
    rows, columns, _ = low.shape
    kind, count = low.dtype.type, place.shape[0]
    tiny = 1.2e-38
    energy = np.empty((rows, columns))
    highest = 0.0
    for r in range(rows):
        for c in range(columns):
            total = 0.0
            for d in range(4):
                total += max(low[r, c, d], kind(0))
            energy[r, c] = sqrt(total)
            highest = max(highest, energy[r, c])
    top = max(peak[0] * (1 - p.dt / p.tau_peak), highest)
    peak[0] = top
    median = np.sort(energy.ravel())[(rows * columns - 1) // 2]  # the lower one, as torch has it

    # Every window by itself, but for what they share where they overlap.
    down, across = np.empty((count, rows)), np.empty((count, columns))
    share_down, share_across = np.zeros((count, rows)), np.zeros((count, columns))
    for k in range(count):
        for axis in range(2):
            place[k, axis] += velocity[k, axis] * p.dt
        for r in range(rows):
            down[k, r] = offset(r - place[k, 0], rows, wrap)
        for c in range(columns):
            across[k, c] = offset(c - place[k, 1], columns, wrap)
        if opened[k]:
            for r in range(rows):
                share_down[k, r] = exp(-(down[k, r] ** 2) / (2 * p.window**2))
            for c in range(columns):
                share_across[k, c] = exp(-(across[k, c] ** 2) / (2 * p.window**2))
    crowd = np.empty((rows, columns))
    for r in range(rows):
        for c in range(columns):
            total = p.crowd
            for k in range(count):
                total += share_down[k, r] * share_across[k, c]
            crowd[r, c] = total
    first, lights = np.empty(count, np.bool_), np.empty(count)
    inside, own = np.empty(10), np.empty(4)
    for k in range(count):
        first[k] = age[k] < p.dt / 2
        own_ways(velocity[k], age[k], p, own)
        inside[:] = 0
        strongest = weights = shares = size = toward_rows = toward_columns = 0.0
        for r in range(rows):
            for c in range(columns):
                window = share_down[k, r] * share_across[k, c]
                total = 0.0
                for d in range(4):
                    total += own[d] * max(low[r, c, d], kind(0))
                moves = sqrt(total)
                shared = window * window / crowd[r, c]
                weight = shared * moves
                strongest = max(strongest, window * moves)
                weights, shares, size = weights + weight, shares + shared, size + window
                toward_rows += weight * down[k, r]
                toward_columns += weight * across[k, c]
                for n in range(10):
                    inside[n] += window * low[r, c, n]
        seen = opened[k] and strongest > max(p.visible * top, median)
        lights[k] = weights / max(shares, tiny)
        follow(place[k], velocity[k], (toward_rows, toward_columns), max(weights, tiny), seen, age[k], p)
        age[k] += p.dt if opened[k] else 0.0
        unseen[k] = 0.0 if seen else unseen[k] + p.dt

        a_high, take = p.dt / (p.tau_high + p.dt), p.dt / p.tau_bind if seen else 0.0
        for n in range(10):
            inside[n] /= max(size, tiny)
            mean[k, n] = inside[n] if first[k] else mean[k, n] + a_high * (inside[n] - mean[k, n])
            inside[n] -= mean[k, n]
        for n in range(10):
            for m in range(10):
                covariance[k, n, m] += take * (inside[n] * inside[m] - covariance[k, n, m])
    a_high, take = p.dt / (p.tau_high + p.dt), p.dt / p.tau_light
    for k in range(count):
        light_mean[k] = lights[k] if first[k] else light_mean[k] + a_high * (lights[k] - light_mean[k])
        lights[k] -= light_mean[k]
    for k in range(count):
        for j in range(count):
            before = 0.0 if first[k] or first[j] else light[k, j]
            light[k, j] = before + take * (lights[k] * lights[j] - before)
    close(place, velocity, opened, age, unseen, light, p, (rows, columns), wrap)
    open_one(energy, top, median, place, velocity, opened, age, unseen, covariance, p, wrap)


@jit
def offset(difference: float, size: int, wrap: bool) -> float:
    """A difference of places, the short way around where the scene is a torus."""
    return (difference + size / 2) % size - size / 2 if wrap else difference


@jit
def own_ways(velocity: Array, age: float, p: WindowNumbers, own: Array) -> None:
    """`own_direction` of one window: how much left, right, down and up count."""
    speed = sqrt(velocity[0] ** 2 + velocity[1] ** 2)
    sure = min(max((age - p.aim) / p.aimed, 0.0), 1.0) if speed > p.slow * p.fastest else 0.0
    down, right = velocity[0] / max(speed, 1e-6), velocity[1] / max(speed, 1e-6)
    own[0] = sure * max(-right, 0.0) ** 2 + (1 - sure)
    own[1] = sure * max(right, 0.0) ** 2 + (1 - sure)
    own[2] = sure * max(down, 0.0) ** 2 + (1 - sure)
    own[3] = sure * max(-down, 0.0) ** 2 + (1 - sure)


@jit
def follow(
    place: Array,
    velocity: Array,
    toward: tuple[float, float],
    weights: float,
    seen: bool,
    age: float,
    p: WindowNumbers,
) -> None:
    """Correct place and velocity of one window, `[2]`, by what it saw."""
    young = age < p.young
    alpha = max(p.gain, p.young_gain) if young else p.gain
    beta = max(p.drift, p.young_drift) if young else p.drift
    if seen:
        for axis in range(2):
            step = min(max(toward[axis] / weights, -p.reach), p.reach)
            place[axis] += alpha * step
            velocity[axis] += beta * step / (p.updates * p.dt)
    speed = sqrt(velocity[0] ** 2 + velocity[1] ** 2)
    for axis in range(2):
        velocity[axis] *= p.fastest / max(speed, p.fastest)


@jit
def close(
    place: Array,
    velocity: Array,
    opened: Array,
    age: Array,
    unseen: Array,
    light: Array,
    p: WindowNumbers,
    grid: tuple[int, int],
    wrap: bool,
) -> None:
    """Close the windows of `closed`."""
    count = place.shape[0]
    closing = np.zeros(count, np.bool_)
    shift, ends = np.zeros((count, 2)), np.zeros(count)
    for k in range(count):
        closing[k] = unseen[k] > p.lost or (age[k] < p.confirm and unseen[k] > p.blind)
        for j in range(count):
            older = age[j] > age[k] or (age[j] == age[k] and j < k)
            if not (opened[k] and opened[j] and older):
                continue
            down = offset(place[k, 0] - place[j, 0], grid[0], wrap)
            across = offset(place[k, 1] - place[j, 1], grid[1], wrap)
            apart = sqrt(down**2 + across**2)
            drift = sqrt((velocity[k, 0] - velocity[j, 0]) ** 2 + (velocity[k, 1] - velocity[j, 1]) ** 2)
            deviations = sqrt(max(light[k, k], 1.2e-38)) * sqrt(max(light[j, j], 1.2e-38))
            alike = light[k, j] / deviations > p.alike and min(age[k], age[j]) > p.known
            if drift < p.alike_speed and (apart < p.same or (apart < p.near and alike)):
                closing[k] = True
                if apart >= p.same:
                    # Both ends of one object: the older window goes on in the middle.
                    shift[j, 0], shift[j, 1], ends[j] = shift[j, 0] + down, shift[j, 1] + across, ends[j] + 1
    for k in range(count):
        if closing[k]:
            opened[k] = False
        for axis in range(2):
            place[k, axis] += shift[k, axis] / (ends[k] + 1)


@jit
def open_one(
    energy: Array,
    top: float,
    median: float,
    place: Array,
    velocity: Array,
    opened: Array,
    age: Array,
    unseen: Array,
    covariance: Array,
    p: WindowNumbers,
    wrap: bool,
) -> None:
    """Open a window where the largest motion is that no window claims, as `opened` does."""
    rows, columns = energy.shape
    slot = -1
    for k in range(place.shape[0]):
        if slot < 0 and not opened[k]:
            slot = k
    height, where_row, where_column = 0.0, 0, 0
    for r in range(rows):
        for c in range(columns):
            here = energy[r, c]
            if (
                here > height
                and summit(energy, r, c, wrap)
                and not claimed(r, c, place, opened, p, rows, columns, wrap)
            ):
                height, where_row, where_column = here, r, c
    if slot < 0 or not height > p.birth * top or not height > p.contrast * median or not height > 0:
        return
    place[slot, 0], place[slot, 1] = where_row, where_column
    velocity[slot, 0] = velocity[slot, 1] = 0
    opened[slot] = True
    age[slot] = unseen[slot] = 0
    covariance[slot] = 0


@jit
def summit(energy: Array, row: int, column: int, wrap: bool) -> bool:
    """Whether no neighbor exceeds a field."""
    rows, columns = energy.shape
    for down in range(-1, 2):
        for across in range(-1, 2):
            r, c = row + down, column + across
            if wrap:
                r, c = r % rows, c % columns
            elif r < 0 or c < 0 or r >= rows or c >= columns:
                continue
            if energy[r, c] > energy[row, column]:
                return False
    return True


@jit
def claimed(
    row: int, column: int, place: Array, opened: Array, p: WindowNumbers, rows: int, columns: int, wrap: bool
) -> bool:
    """Whether a field is within reach of a window."""
    for k in range(place.shape[0]):
        down = offset(row - place[k, 0], rows, wrap)
        across = offset(column - place[k, 1], columns, wrap)
        if opened[k] and sqrt(down**2 + across**2) < p.claim:
            return True
    return False
