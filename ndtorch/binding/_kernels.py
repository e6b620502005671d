"""Kernels of the inhibitory networks: the same numbers as `network_step`."""

from __future__ import annotations

from math import exp, expm1, inf, log1p, tanh
from typing import NamedTuple

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_frame import Array

SQUARINGS = 14
"""Of a matrix at most: then its powers are of the 16384th."""

TIGHT = 1e-10
"""How far apart two estimates of a spectral radius may be, as a share of it."""


class DelayedNumbers(NamedTuple):
    """Filters, bounds and the numbers of the rule's functions."""

    a_in: float
    a_out: float
    a_mean: float
    a_rough: float
    largest: float
    radius_limit: float
    row: int
    column: int


@jit
def delayed_network(
    inputs: Array,
    first: int,
    factors: Array,
    weights: Array,
    neurons: Array,
    mean: Array,
    p: DelayedNumbers,
    outputs: Array,
    shifts: Array,
) -> int:
    """Steps of `InhibitoryNetwork`, one after the other, until the weights may be too large to tell here.

    Args:
        inputs: `[T, N]`.
        first: number of the first step.
        factors: what the rule's change is multiplied by at every step, negative before learning begins, `[T]`; none of
            fixed weights, `[0]`.
        weights, mean: `weights` and `mean_weights` of `NetworkState`; they become those after the last step done.
        neurons: its `outputs`, `input_low`, `output_low`, `power` and `roughness`, `[5, N]`, likewise.
        p: constants; functions in the order of `FUNCTIONS` of `ndtorch.binding.network_kernels`.
        outputs: become those of the steps done, `[T, N]`.
        shifts: become the summed magnitudes of the changes of the mean weights, `[T]`.

    Returns:
        The number of the first step that is not done; T if there is none.
    """
    steps, count = inputs.shape
    kind = inputs.dtype.type
    out, drive_low, low, high = neurons[0].copy(), neurons[1].copy(), neurons[2].copy(), neurons[2].copy()
    grown = np.empty((count, count), inputs.dtype)
    for t in range(first, steps):
        for n in range(count):
            drive_low[n] = (
                neurons[1, n] + kind(p.a_in) * (inputs[t, n] - neurons[1, n]) if p.a_in > 0 else neurons[1, n]
            )
            total = inputs[t, n] - drive_low[n] if p.a_in > 0 else inputs[t, n]
            for k in range(count):
                total -= weights[n, k] * neurons[0, k]
            out[n] = total
        shifts[t] = 0
        if factors.shape[0] > 0:
            for n in range(count):
                low[n] = neurons[2, n] + kind(p.a_out) * (out[n] - neurons[2, n])
                high[n] = out[n] - low[n]
            if factors[t] >= 0:
                for n in range(count):
                    change = factors[t] * applied(p.row, high[n])
                    for k in range(count):
                        wanted = weights[n, k] + (change * applied(p.column, high[k]) if n != k else kind(0))
                        grown[n, k] = min(max(wanted, kind(0)), kind(p.largest))
                scale = 1.0 if p.radius_limit == inf else held_back(grown, p.radius_limit)
                if not scale > 0:
                    return t
                for n in range(count):
                    for k in range(count):
                        weights[n, k] = grown[n, k] if scale == 1 else kind(grown[n, k] * scale)
                        step = (weights[n, k] - mean[n, k]) * kind(p.a_mean)
                        mean[n, k] += step
                        shifts[t] += abs(step)
        for n in range(count):
            rough, square = out[n] - neurons[0, n], out[n] * out[n]
            neurons[3, n] += kind(p.a_rough) * (square - neurons[3, n])
            neurons[4, n] += kind(p.a_rough) * (rough * rough - neurons[4, n])
            neurons[0, n], neurons[1, n], neurons[2, n] = out[n], drive_low[n], low[n]
            outputs[t, n] = out[n]
    return int(steps)


@jit
def applied(function: int, x: float) -> float:
    """One of the functions of the rules."""
    if function == 0:
        return x
    if function == 1:
        return x * x * x
    bent: float = tanh(x * (np.pi if function == 2 else 10.0))
    return bent


@jit
def held_back(weights: Array, limit: float) -> float:
    """What weights are multiplied by so that their spectral radius keeps to a limit; NaN where that is not certain."""
    count = weights.shape[0]
    power, next_power, size, most = np.empty((count, count)), np.empty((count, count)), 0.0, 0.0
    for n in range(count):
        for k in range(count):
            most = max(most, weights[n, k])
    if most == 0:
        return 1.0
    multiply(weights, weights, power)
    multiply(power, power, next_power)
    for n in range(count):
        for k in range(count):
            size += next_power[n, k] * next_power[n, k]
    # The fourth power bounds the radius, and settles most cases.
    if size <= limit**8:
        return 1.0
    for n in range(count):
        for k in range(count):
            power[n, k] = weights[n, k] / most + (1.0 if n == k else 0.0)
    for _ in range(SQUARINGS):
        multiply(power, power, next_power)
        total = 0.0
        for n in range(count):
            for k in range(count):
                total += next_power[n, k]
        for n in range(count):
            for k in range(count):
                power[n, k] = next_power[n, k] / total
        root = estimate(weights, power)
        if root > 0:
            factor: float = min(limit * (1 - 1e-6) / root, 1.0)
            return factor
    return np.nan


@jit
def estimate(weights: Array, power: Array) -> float:
    """The spectral radius from a high power of `W + I`, see `perron_root`; 0 where two estimates are apart."""
    count, root, above, below = weights.shape[0], 0.0, 0.0, 0.0
    right, left = np.zeros(count), np.zeros(count)
    for n in range(count):
        for k in range(count):
            right[n] += power[n, k]
            left[k] += power[n, k]
    for n in range(count):
        image = 0.0
        for k in range(count):
            image += weights[n, k] * right[k]
        if not right[n] > 0:
            return 0.0
        root = max(root, image / right[n])
        above += left[n] * image
        below += left[n] * right[n]
    tight: float = root if root - above / below <= TIGHT * root else 0.0
    return tight


@jit
def multiply(a: Array, b: Array, out: Array) -> None:
    """The product of two matrices in double precision."""
    count = a.shape[0]
    for n in range(count):
        for k in range(count):
            out[n, k] = 0
        for m in range(count):
            factor = float(a[n, m])
            for k in range(count):
                out[n, k] += factor * b[m, k]


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
def over_recent_maxima(signals: Array, ends: Array, keep: float, floor: float, level: Array, inputs: Array) -> None:
    """See `ndtorch.binding.normalise.FieldInputs`.

    Args:
        signals: `[T, F, N]`, and inputs: become those over the levels.
        ends: the feature after the last one of each group, `[G]`.
        keep: share of the level that is left a step later.
        level: largest signals of each group lately, `[G]`; updated.
    """
    kind, begin = signals.dtype.type, 0
    for g in range(ends.shape[0]):
        for t in range(signals.shape[0]):
            level[g] = max(kind(keep) * level[g], signals[t, :, begin : ends[g]].max())
            least = max(level[g], kind(floor))
            for f in range(signals.shape[1]):
                for n in range(begin, ends[g]):
                    inputs[t, f, n] = signals[t, f, n] / least
        begin = ends[g]


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
