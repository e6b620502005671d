"""The step of the ranging controller of one car: remember what is seen, measure the free arcs, decide."""

from __future__ import annotations

from typing import Any

import numpy as np

from ndtorch.kernels.decision import decision
from ndtorch.kernels.floor_cells import floor_cells
from ndtorch.kernels.patch_arcs import patch_arcs
from ndtorch.kernels.trail import follow_trail, lay_trail
from ndtorch.utils.jit import jit

Array = Any

seen_floor, free_arcs, decided = floor_cells, patch_arcs, jit(decision, exact=True)
laid, followed = jit(lay_trail, exact=True), jit(follow_trail, exact=True)


@jit
def ranging_control(
    cells: Array,
    ranges: tuple[Array, Array, Array],
    numbers: Array,
    memory: tuple[Array, Array, Array, Array, Array],
    new_memory: tuple[Array, Array, Array, Array, Array],
    after: Array,
    tables: tuple[Array, Array, Array, Array, Array],
    floor: tuple[float, ...],
    worth: tuple[float, float, float],
    patch: tuple[float, float, float, float, float, float, float, float, float],
    arcs: tuple[int, int, int, float],
    choice: tuple[Array, Array, Array],
    limits: tuple[float, ...],
    beam: tuple[float, float, float, float],
) -> None:
    """`RangingControl.step`.

    Args:
        cells: `[4, bands, blocks]`, or the first half of it.
        ranges: x, y and valid, `[n]`.
        numbers: speed and curvature driven; pose; noise and age of the floor, `Machine`, and how many poses
            are on the trail.
        memory, new_memory: level `[bands]`, evidence `[size, size]`, tag `[2, size]`, what stands `[size, size]` or
            `[0, 0]`, and trail `[poses, 3]`.
        after: as `numbers`, with the speed and curvature to drive; the pose is left alone.
        tables: flow, profile, places and what is under the car, as of `RangingControl`, and the lines of sight of
            `remember_ranges`.
        floor: numbers of `floor_cells`.
        worth: evidence of the floor's end, of floor, and of a range.
        patch: share that is kept, and while boxed in; the mode of that; reach, cell, least and most evidence, and
            the two limits of `patch_arcs`.
        arcs: leading, steps, number of arcs, step.
        choice: comparison, table, moves of `decision`; limits: its numbers.
        beam: of `remember_ranges`.
    """
    level, evidence, tag, upright, trail = memory
    flow, profile, places, under, line = tables
    _, bands, blocks = cells.shape
    marked = 2 * bands * blocks
    marks = np.empty(marked + under.size, cells.dtype)
    for k in range(under.size):
        marks[marked + k] = under[k]
    evident = marks[:marked].reshape((2, bands, blocks))
    speed, noise, age = float(numbers[0]), float(numbers[5]), float(numbers[6]) + 1
    noise = seen_floor(
        cells,
        (speed, float(numbers[1])),
        level,
        noise,
        age,
        flow,
        profile,
        floor,
        new_memory[0],
        (worth[0], worth[1]),
        evident,
    )
    leading, steps, count, step = arcs
    keep, fade, stopped, reach, cell, least, most, blocked, unknown = patch
    lengths = np.empty((2, count), cells.dtype)
    free_arcs(
        evidence,
        tag,
        (float(numbers[2]), float(numbers[3]), float(numbers[4])),
        fade if numbers[7] == stopped else keep,
        ranges,
        reach,
        worth[2],
        places,
        marks,
        (upright, new_memory[3], line, under.size, beam),
        cell,
        (least, most),
        (blocked, unknown),
        leading,
        steps,
        step,
        new_memory[1],
        new_memory[2],
        lengths,
    )
    far = np.empty(lengths.shape)
    for row in range(2):
        for arc in range(count):
            far[row, arc] = lengths[row, arc]
    mode, age_of_mode, side = float(numbers[7]), float(numbers[8]), float(numbers[9])
    swing, gone, bold, difference = float(numbers[10]), float(numbers[11]), float(numbers[12]), float(numbers[13])
    machine = (mode, age_of_mode, side, swing, gone, bold, difference)
    here = (float(numbers[2]), float(numbers[3]), float(numbers[4]))
    poses = laid(trail, float(numbers[14]), here, speed, new_memory[4])
    back = followed(new_memory[4], poses, here, limits[-1])
    ahead, bend, machine = decided(
        far, speed, back, (age, floor[5], floor[6]), machine, choice[0], choice[1], choice[2], limits
    )
    after[0], after[1], after[5], after[6] = ahead, bend, noise, age
    after[7], after[8], after[9], after[10], after[11], after[12], after[13] = machine
    after[14] = poses
