"""Some steps of one network with delayed feedback, and of a rule that multiplies functions of two outputs."""

from __future__ import annotations

from math import inf, tanh
from typing import NamedTuple

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.utils.jit import jit

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
        p: constants; functions in the order of `FUNCTIONS` of `ndtorch.binding.delayed_kernel`.
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
