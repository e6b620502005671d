"""Compiled: the step of the published controller of one car, from pixels to a command."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ndtorch.navigation.controllers.contract import Command
from ndtorch.navigation.stereo._kernels import Array, Frames, cell_maxima, grey_row, is_finite
from ndtorch.utils.jit import jit
from ndtorch.vision.nondirectional import SPEED_SCALE


class AvoidanceState(NamedTuple):
    """State of `SaccadeAvoidance`, every part `[...]`; numbers in `SaccadeController`.

    Attributes:
        difference: right minus left, low-passed: positive where the car should rather turn left.
        age: time steps since the last turn began; minus infinity once the car has stopped.
        curvature: what is being driven, 1/m, to the left positive.
    """

    difference: Any
    age: Any
    curvature: Any


class SaccadeNumbers(NamedTuple):
    """`AvoidanceParams` for one time step, radii as curvatures and times as steps, and what `SubfieldMotion` reads.

    Attributes:
        age: of a car that begins.
        a: share of the high-pass.
        left_top, left_left, right_top, right_left: corners of the subfields in whole frames.
    """

    smoothing: float
    turn_threshold: float
    high_threshold: float
    low_threshold: float
    normal: float
    tight: float
    turn_steps: float
    watching: float
    speed: float
    age: float
    a: float
    left_top: int
    left_left: int
    right_top: int
    right_left: int


@jit(exact=True)
def avoidance(left: float, right: float, state: AvoidanceState, p: SaccadeNumbers) -> tuple[Command, AvoidanceState]:
    """`avoidance_step` of one car in plain numbers."""
    now = right - left
    difference = state.difference + p.smoothing * (now - state.difference)
    age, curvature = state.age + 1.0, state.curvature
    cruising, high = age >= p.watching, min(left, right) > p.high_threshold
    stop = cruising and max(left, right) < p.low_threshold
    if cruising and not stop and (high or abs(difference) > p.turn_threshold):
        curvature = math.copysign(p.tight, now) if high else math.copysign(p.normal, difference)
        age = 0.0
    elif age >= p.turn_steps:
        curvature = 0.0
    if stop:
        age = -math.inf
    return Command(p.speed if age > -math.inf else 0.0, curvature), AvoidanceState(difference, age, curvature)


@jit(exact=True)
def saccade_step(
    left: Array,
    right: Array,
    interleaved: bool,
    scale: float,
    low: Array,
    machine: tuple[float, float, float],
    settle: bool,
    new_low: Array,
    numbers: Array,
) -> tuple[tuple[float, float], tuple[float, float, float]]:
    """`SubfieldMotion` and `SaccadeAvoidance` of one whole uint8 frame of each camera: command and state machine.

    Plain tuples, since Numba takes 2 us to recognise a NamedTuple.

    Args:
        left, right, interleaved, scale: as in `Frames`.
        low, new_low: states of the high-pass before and after, `[2, h, w]`.
        machine: the state machine before; it and `low` are not read where the car begins on this frame, `settle`.
        numbers: `packed` `SaccadeNumbers`.
    """
    p, cells = numbers[0], np.empty((2, 1, 1), np.float32)
    tops, lefts = (p.left_top, p.right_top), (p.left_left, p.right_left)
    subfield_maxima(Frames(left, right, interleaved, scale, tops, lefts), settle, low, p.a, new_low, cells)
    ours = np.float64(cells[0, 0, 0] * np.float32(SPEED_SCALE))
    theirs = np.float64(cells[1, 0, 0] * np.float32(SPEED_SCALE))
    before = (theirs - ours, p.age, 0.0) if settle else machine
    command, after = avoidance(ours, theirs, AvoidanceState(before[0], before[1], before[2]), p)
    return (command.speed, command.curvature), (after.difference, after.age, after.curvature)


@jit
def subfield_maxima(frames: Frames, settle: bool, low: Array, a: float, new_low: Array, cells: Array) -> float:
    """`SubfieldMotion` of one frame: the largest |ND-min| of each rectangle into `cells` `[2, 1, 1]`."""
    grey = np.empty(new_low.shape, new_low.dtype)
    for y in range(grey.shape[1]):
        top, left = frames.tops, frames.lefts
        grey_row(frames.left, frames.interleaved, top[0] + y, left[0], np.intp(1), frames.scale, grey[0, y])
        grey_row(frames.right, frames.interleaved, top[1] + y, left[1], np.intp(1), frames.scale, grey[1, y])
    peak = cell_maxima(grey, settle, low, 1.0, a, new_low, cells)
    return peak if frames.left.itemsize == 1 or is_finite(grey) else np.nan
