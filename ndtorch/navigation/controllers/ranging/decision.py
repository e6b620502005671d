"""What the ranging controller drives next: from the free lengths of its arcs to a mode and its command."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.navigation.controllers.contract import CRUISE, REVERSE, STOPPED, TURN, Command
from ndtorch.navigation.controllers.ranging.floor import FloorConstants, FloorState
from ndtorch.navigation.controllers.ranging.modes import MODES, Facts, transition_table
from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.controllers.ranging.patch import Patch
from ndtorch.navigation.controllers.ranging.trail import Trail, back, lay
from ndtorch.navigation.odometry import Pose


class RangingState(NamedTuple):
    """State of `RangingControl`.

    Attributes:
        floor: what was learned of the floor.
        patch: what is remembered of the surroundings.
        mode: what the car is doing, `[...]` as all that follow.
        age: time steps since that began.
        side: +1 turns to the left, -1 to the right.
        swing: 1 when reversing turns the car on towards that side, 0 when it goes back on its trail or straight.
        gone: metres reversed.
        bold: 1 from reversing to the next cruise: the car has backed once and now turns into what it has not
            seen free.
        difference: length of the free arcs on the left minus the right, m.
        trail: where it has just driven.
    """

    floor: FloorState
    patch: Patch
    mode: Tensor
    age: Tensor
    side: Tensor
    swing: Tensor
    gone: Tensor
    bold: Tensor
    difference: Tensor
    trail: Trail


class Constants(NamedTuple):
    """`RangingParams` for one time step as tensors, and the tables of the transitions and of what each mode drives."""

    limits: Tensor
    comparison: Tensor
    evidence: Tensor
    table: Tensor
    facts: Tensor
    powers: Tensor
    speeds: Tensor
    bends: Tensor
    turn_at: Tensor
    go_at: Tensor
    wide_needs: Tensor
    least: Tensor
    turn_steps: Tensor
    reverse_length: Tensor
    reversed: Tensor
    rear: Tensor
    room: Tensor
    prefer: Tensor
    grace: Tensor
    swing: Tensor
    wide_swing: Tensor
    metres: Tensor
    keep: Tensor
    fade: Tensor
    reach: Tensor
    one: Tensor
    zero: Tensor
    reverse: Tensor
    turn: Tensor
    cruise: Tensor
    tightest: Tensor
    stopped: Tensor


def ranging_constants(params: RangingParams, dt: float) -> Constants:
    """Numbers of `decide`, and of the step that leads to it."""
    p, table = params, transition_table()
    wide, tight = 1 / p.turn_radius, 1 / p.tight_radius
    # Speed and curvature towards `side` of every mode, with (wide, swing) = (0, 0), (0, 1), (1, 0), (1, 1).
    speeds = {TURN: [p.tight_speed] * 2 + [p.speed] * 2, REVERSE: [-p.reverse_speed] * 4, STOPPED: [0.0] * 4}
    bends = {TURN: [tight] * 2 + [wide] * 2, REVERSE: [0.0, -tight] * 2}
    speed = torch.tensor([v for m in range(MODES) for v in speeds.get(m, [p.speed] * 4)])
    bend = torch.tensor([v for m in range(MODES) for v in bends.get(m, [0.0] * 4)])
    comparison = torch.tensor([1.0, p.known_share])[:, None] * torch.tensor([0.0, 1.0, 1.0, -1.0, -1.0])
    numbers = (
        p.turn_at,
        p.go_at,
        p.wide_needs,
        p.least,
        round(p.turn_time / dt),
        p.reverse_length,
        min(0.15, p.reverse_length),
        0.1,
        p.room,
        p.prefer,
        p.grace,
        0.3,
        0.6,
        dt,
        math.exp(-dt / p.patch.lifetime),
        math.exp(-dt / p.fading),
        p.patch.reach,
        1.0,
        0.0,
        REVERSE,
        TURN,
        CRUISE,
        tight,
        STOPPED,
    )
    return Constants(
        torch.tensor([p.blocked, -0.1 * p.blocked]),
        comparison,
        torch.tensor([p.hidden_weight, p.floor_weight, p.range_weight]),
        table,
        torch.tensor(float(len(table) // MODES)),
        2.0 ** torch.arange(len(Facts._fields)),
        speed,
        bend,
        *(torch.tensor(float(value)) for value in numbers),
    )


def decide(
    lengths: Tensor,
    driven: Command,
    floor: FloorState,
    patch: Patch,
    state: RangingState,
    constants: Constants,
    timing: FloorConstants,
    pose: Pose,
) -> tuple[Command, RangingState]:
    """The next mode and its command.

    Args:
        lengths: of the arcs, first to what blocks them and then to what is not known, `[..., 2, 8]`, m.
        driven: what the car drove since the last frame.
        floor, patch: their new states.
        state: of the controller before.
        constants: its numbers.
        timing: how long it stands and learns at the start.
        pose: where the car is.
    """
    c = constants
    difference = (lengths[..., :5] * c.comparison).sum((-2, -1))
    reversing = state.mode == c.reverse
    # A turn and what belongs to it stays on its side; else the longer arcs decide.
    bound = reversing | (state.mode == c.turn) | (difference.abs() < c.prefer)
    side = torch.where(bound, state.side, difference.sign())
    left = (side > c.zero).unsqueeze(-1)
    free, known = lengths.unbind(-2)
    straight = free[..., 0]
    confined = torch.minimum(free, known + c.grace)
    wide, tight = torch.where(left, confined[..., 1:3], confined[..., 3:5]).unbind(-1)
    longest = torch.maximum(wide, tight)
    blocked = torch.where(left, free[..., 1:3], free[..., 3:5]).amax(-1) < c.least
    swing_back = torch.where(left[..., 0], confined[..., 5], confined[..., 7])
    trail = lay(state.trail, pose, driven.speed)
    track, follow = back(trail, pose, c.tightest)
    # Where the body came from it was free all along, whatever is remembered of it. But only turning on brings a car
    # out of a corner: it does so where there is much room.
    swings = (swing_back > c.swing) & ((track < c.rear) | (swing_back > c.wide_swing))
    swing = torch.where(reversing, state.swing, swings.to(side.dtype))
    tracked = (track >= c.rear) & (swing <= c.zero)
    # Only a car that cannot go ahead at all backs into what it has not seen.
    straight_back = torch.where(blocked, free[..., 6], confined[..., 6])
    rear = torch.where(tracked, track, torch.where(swing > c.zero, swing_back, straight_back))
    # Before a turn into what was not seen free the car backs once, if it knows that it can.
    unseen = (longest < c.least) & (rear >= c.swing) & (state.bold < c.one)
    gone = torch.where(reversing, state.gone - driven.speed * c.metres, c.zero)
    age = state.age + c.one
    facts = (  # in the order of `Facts`
        floor.age < timing.learning,
        straight < c.turn_at,
        (straight >= c.go_at) & (age >= c.turn_steps),
        blocked | unseen,
        ((gone >= c.reverse_length) & ~tracked) | (rear < c.rear),
        (gone >= c.reversed) & (longest >= c.room),
        rear < c.rear,
    )
    code = torch.stack(facts, -1).to(c.powers.dtype) @ c.powers
    mode = look_up(c.table, code + state.mode * c.facts).to(side.dtype)
    # Once tight, a turn stays tight until its arc is long.
    roomy = (wide >= c.wide_needs).to(side.dtype)
    row = mode * 4 + roomy * 2 + swing
    stands = floor.age <= timing.standing
    speed = torch.where(stands, c.zero, look_up(c.speeds, row))
    age = torch.where(mode == state.mode, age, c.zero)
    bold = torch.where(mode == c.reverse, c.one, torch.where(mode == c.cruise, c.zero, state.bold))
    bend = torch.where(tracked & (mode == c.reverse), follow, look_up(c.bends, row) * side)
    going = RangingState(floor, patch, mode, age, side, swing, gone, bold, difference, trail)
    return Command(speed, bend), going


def look_up(table: Tensor, number: Tensor) -> Tensor:
    """Entries of a table `[n]` at whole numbers of any shape. A single one is looked up as a row, so that it is
    not taken for a number known beforehand when the step is compiled."""
    return table[number.long().unsqueeze(-1)].squeeze(-1)
