"""Some steps of one network that many fields share, with settled feedback and the scale-free rule."""

from __future__ import annotations

from math import exp, expm1, log1p
from typing import NamedTuple

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.utils.jit import jit


class RuleNumbers(NamedTuple):
    """The rule and the filters as plain numbers."""

    dt: float
    faint: float
    a_out: float
    a_power: float
    a_mean: float
    gamma: float
    boost: float
    tau_boost: float
    tau_onset: float
    exponent: float
    leak: float
    floor: float
    lowest: float
    highest: float
    radius_limit: float


@jit
def shared_network(
    drive: Array,
    first: int,
    weights: Array,
    low: Array,
    fluctuation: Array,
    clock: Array,
    mean: Array,
    p: RuleNumbers,
    outputs: Array,
    shifts: Array,
) -> int:
    """`network_step` for one step after the other, until the weights may be too large.

    Args:
        drive: inputs `[T, F, N]`.
        first: number of the first step.
        weights, low, fluctuation, mean: `weights`, `output_low`, `fluctuation` and `mean_weights` of `NetworkState`;
            they become those after the last step done.
        clock: likewise, `[1]` float64.
        p: constants.
        outputs: become those of the steps done, `[T, F, N]`.
        shifts: become the summed magnitudes of the changes of the mean weights, `[T]`.

    Returns:
        The number of the first step that is not done: its weights may be beyond their limit. T if there is none.
    """
    steps, fields, count = drive.shape
    kind = drive.dtype.type
    high, strength, relative = np.empty((fields, count), drive.dtype), np.empty(count), np.empty(count)
    correlation, grown = np.empty((count, count)), np.empty((count, count))
    power, lows = np.empty(count), np.empty((fields, count), drive.dtype)
    for t in range(first, steps):
        gain = inverse(weights)
        most = 0.0
        for f in range(fields):
            size = 0.0
            for n in range(count):
                total = 0.0
                for k in range(count):
                    total += gain[n, k] * drive[t, f, k]
                outputs[t, f, n] = total
                lows[f, n] = low[f, n] + kind(p.a_out) * (outputs[t, f, n] - low[f, n])
                high[f, n] = outputs[t, f, n] - lows[f, n]
                size += high[f, n] * high[f, n]
            most = max(most, size / count)
        shifts[t] = 0
        if most < p.faint**2:
            low[:] = lows
            continue
        now = clock[0] + 1
        seconds = now * p.dt
        onset = -expm1(-seconds / p.tau_onset) if p.tau_onset > 0 else 1.0
        rate = p.gamma * (1 + p.boost * exp(-seconds / p.tau_boost)) * onset * p.dt
        seen = -expm1(log1p(-p.a_power) * now) if p.a_power < 1 else 1.0
        for n in range(count):
            for k in range(count):
                total = 0.0
                for f in range(fields):
                    total += high[f, n] * high[f, k]
                correlation[n, k] = total
        largest = 1.2e-38
        for n in range(count):
            power[n] = (1 - p.a_power) * fluctuation[n] + p.a_power * correlation[n, n]
            largest = max(largest, power[n] / seen)
        for n in range(count):
            relative[n] = max(power[n] / seen / largest, p.floor**2)
            strength[n] = relative[n] ** (p.exponent / 2)
        for n in range(count):
            for k in range(count):
                gate = strength[k] / (strength[k] + strength[n])
                change = gate * correlation[n, k] / (relative[k] * largest) - p.leak * (1 - gate) * weights[n, k]
                wanted = weights[n, k] + (rate * change if n != k else 0.0)
                grown[n, k] = min(max(wanted, p.lowest), p.highest)
        if not within(grown, p.radius_limit):
            return t
        for n in range(count):
            fluctuation[n] = power[n]
            for k in range(count):
                weights[n, k] = grown[n, k]
                step = (weights[n, k] - mean[n, k]) * p.a_mean
                mean[n, k] += step
                shifts[t] += abs(step)
        low[:] = lows
        clock[0] = now
    return int(steps)


@jit
def inverse(weights: Array) -> Array:
    """`(I + W)^-1`, `[N, N]` in double precision."""
    count = weights.shape[0]
    both = np.zeros((count, 2 * count))
    for n in range(count):
        for k in range(count):
            both[n, k] = weights[n, k]
        both[n, n] += 1
        both[n, count + n] = 1
    for n in range(count):
        best = n
        for k in range(n + 1, count):
            if abs(both[k, n]) > abs(both[best, n]):
                best = k
        for k in range(2 * count):
            both[n, k], both[best, k] = both[best, k], both[n, k]
        scale = 1 / both[n, n]
        for k in range(2 * count):
            both[n, k] *= scale
        for m in range(count):
            factor = both[m, n] if m != n else 0.0
            for k in range(2 * count):
                both[m, k] -= factor * both[n, k]
    return both[:, count:]


@jit
def within(weights: Array, limit: float) -> bool:
    """Whether the fourth power of the weights' magnitudes, which bounds their spectral radius, is within a limit's."""
    count = weights.shape[0]
    squared, size = np.zeros((count, count)), 0.0
    for n in range(count):
        for k in range(count):
            for m in range(count):
                squared[n, k] += abs(weights[n, m]) * abs(weights[m, k])
    for n in range(count):
        for k in range(count):
            total = 0.0
            for m in range(count):
                total += squared[n, m] * squared[m, k]
            size += total * total
    # A little less than the limit: what is near it is looked at more closely.
    return size <= (limit**4 * 0.999) ** 2
