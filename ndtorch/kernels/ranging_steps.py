"""Whole steps of many cars with the ranging controller, one car after the other."""

from __future__ import annotations

from typing import Any

from ndtorch.kernels.inner import inner
from ndtorch.kernels.ranging_step import ranging_step
from ndtorch.kernels.strips import larger

Array = Any

step: Any = inner(ranging_step)


def ranging_steps(
    eyes: tuple[Array, Array, Array, Array],
    whole: Array,
    numbers: Array,
    clock: tuple[float, float, float],
    given: bool,
    driven: Array,
    before: tuple[Array, Array],
    after: tuple[Array, Array],
    valid: Array,
    *rest: Array,
) -> float:
    """`ranging_step` of every car: a call from Python takes as long as a good part of a step.

    Args:
        eyes: `[B, 1, C, H, W]` each, the pixels of left and right fields and rows.
        whole, numbers, clock: of all cars; the latter is `dt`, `drift` and `scale`.
        given, driven: whether somebody says what was driven, and what: `[B, 2]`.
        before, after: the large and the small numbers of the state, `[B, ...]`.
        valid: `[B, n]`.
        rest: the other arguments of a step.

    Returns:
        The largest magnitude of motion; what is no number is larger than all.
    """
    largest = 0.0
    for car in range(driven.shape[0]):
        fields, rows, _ = step(
            eyes[0][car],
            eyes[1][car],
            eyes[2][car],
            eyes[3][car],
            whole,
            numbers,
            clock[0],
            clock[1],
            clock[2],
            False,
            given,
            float(driven[car, 0]),
            float(driven[car, 1]),
            before[0][car],
            before[1][car],
            after[0][car],
            after[1][car],
            valid[car],
            *rest,
        )
        largest = larger(larger(fields, rows), largest)
    return largest
