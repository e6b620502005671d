"""The controller that goes beyond the paper: it drives where it has seen floor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.errors import InputError
from ndtorch.navigation.arcs import Body, arc_table, free_travel
from ndtorch.navigation.avoidance import CRUISE, STOPPED, SUPPRESSED, TURN, Command
from ndtorch.navigation.floor import FloorParams, FloorState, floor_constants, floor_step, floor_view
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.patch import Patch, PatchParams, add_evidence, cell_numbers, empty_patch, move_patch
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.ranging_modes import MODES, REVERSE, Facts, transition_table
from ndtorch.navigation.rig import StereoRig


@dataclass(frozen=True)
class RangingParams:
    """The numbers of the ranging controller.

    Args:
        speed, tight_speed, reverse_speed: m/s ahead and in wide turns, in tight turns, and backward.
        turn_radius, tight_radius: m.
        turn_at: a turn starts when less than this is free straight ahead, m.
        go_at: a turn ends when this is free straight ahead, m.
        wide_needs: free length that the wide turn needs, m; otherwise the tight one is taken.
        least: driving on needs this much, m; with less the car reverses.
        turn_time: shortest turn, s.
        reverse_length: m.
        room: reversing ends early when this much is free on an arc ahead, m.
        prefer: the side to turn to changes only when the arcs on the other are longer by this, m.
        known_share: metres of arc that are known to be floor count this much extra when sides are compared.
        grace: turns and reversing shall go at most this far into what was not seen free, m; inf lets them go
            anywhere.
        floor_weight, hidden_weight, range_weight: evidence that a cell of floor, its end or a range gives a frame.
        blocked: evidence from which a cell counts as blocked; below minus a tenth of it the cell is known to
            be floor.
        fading: time constant at which a car that is boxed in forgets, s.
        body: outline of the car.
        patch: the memory.
        floor: the subfields.
    """

    speed: float = 0.5
    tight_speed: float = 0.4
    reverse_speed: float = 0.3
    turn_radius: float = 1.0
    tight_radius: float = 0.5
    turn_at: float = 1.1
    go_at: float = 1.4
    wide_needs: float = 1.3
    least: float = 0.2
    turn_time: float = 0.3
    reverse_length: float = 0.5
    room: float = 0.9
    prefer: float = 0.25
    known_share: float = 0.5
    grace: float = 0.1
    floor_weight: float = 0.5
    hidden_weight: float = 1.0
    range_weight: float = 1.0
    blocked: float = 1.9
    fading: float = 1.0
    body: Body = field(default_factory=Body)
    patch: PatchParams = field(default_factory=PatchParams)
    floor: FloorParams = field(default_factory=FloorParams)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, float) and not (value > 0 and (math.isfinite(value) or name == "grace")):
                raise InputError(f"{name} must be a number > 0, got {value}")


class RangingState(NamedTuple):
    """State of `RangingControl`.

    Attributes:
        floor: what was learned of the floor.
        patch: what is remembered of the surroundings.
        mode: what the car is doing, `[...]` as all that follow.
        age: time steps since that began.
        side: +1 turns to the left, -1 to the right.
        swing: 1 when reversing turns the car on towards that side, 0 when it goes straight back.
        gone: metres reversed.
        bold: 1 from reversing to the next cruise: the car has backed once and now turns into what it has not
            seen free.
        difference: length of the free arcs on the left minus the right, m.
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


class Constants(NamedTuple):
    """Numbers of one time step as tensors."""

    limits: Tensor
    comparison: Tensor
    evidence: Tensor
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
    metres: Tensor
    keep: Tensor
    fade: Tensor
    reach: Tensor
    one: Tensor
    zero: Tensor
    reverse: Tensor
    turn: Tensor
    cruise: Tensor
    stopped: Tensor


class RangingControl(nn.Module):
    """Drives where floor was seen, and away from where it ends or a range says that something is.

    Shapes:
        cells `[..., T, 2, bands, blocks]` of `FloorMotion`, ranges `[..., T, n]`, poses and driven commands
        `[..., T]` -> `Command` of `[..., T]`. `state=None` starts at the first pose, standing.

    Args:
        rig: the camera pair.
        dt: time step, s.
        params: the numbers.

    Raises:
        InputError: numbers out of range, or inputs that do not belong together.
    """

    def __init__(self, rig: StereoRig, dt: float, params: RangingParams | None = None) -> None:
        super().__init__()
        if not 0 < dt < math.inf:
            raise InputError(f"dt must be a positive number of seconds, got {dt}")
        p = self.params = params or RangingParams()
        self.dt = dt
        view = floor_view(rig, p.floor)
        self.floor = floor_constants(rig, p.floor, view, dt)
        wide, tight = 1 / p.turn_radius, 1 / p.tight_radius
        arcs = [(0.0, 1), (wide, 1), (tight, 1), (-wide, 1), (-tight, 1), (-tight, -1), (0.0, -1), (tight, -1)]
        longest = math.floor(min(1.6, p.patch.reach - 0.5) / p.patch.cell) * p.patch.cell
        self.arcs = arc_table(arcs, p.body, longest, p.patch.cell, lag=0.05)
        body = torch.meshgrid(
            torch.linspace(-0.8, 0.8, 6) * p.body.length, torch.linspace(-0.8, 0.8, 5) * p.body.width, indexing="ij"
        )
        self.marked = view.x.numel() + body[0].numel()
        x = torch.cat((view.x.flatten(), body[0].flatten(), self.arcs.x))
        y = torch.cat((view.y.flatten(), body[1].flatten(), self.arcs.y))
        self.places = torch.stack((x, y))
        self.under = torch.full((body[0].numel(),), -2.0)
        self.numbers = torch.arange(p.patch.size, dtype=torch.get_default_dtype())
        self.table = transition_table()
        self.facts = float(len(self.table) // MODES)
        self.powers = 2.0 ** torch.arange(len(Facts._fields))
        # Speed and curvature towards `side` of every mode, with (wide, swing) = (0, 0), (0, 1), (1, 0), (1, 1).
        speeds = {TURN: [p.tight_speed] * 2 + [p.speed] * 2, REVERSE: [-p.reverse_speed] * 4, STOPPED: [0.0] * 4}
        bends = {TURN: [tight] * 2 + [wide] * 2, REVERSE: [0.0, -tight] * 2}
        self.speeds = torch.tensor([v for m in range(MODES) for v in speeds.get(m, [p.speed] * 4)])
        self.bends = torch.tensor([v for m in range(MODES) for v in bends.get(m, [0.0] * 4)])
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
            dt,
            math.exp(-dt / p.patch.lifetime),
            math.exp(-dt / p.fading),
            p.patch.reach,
            1.0,
            0.0,
            REVERSE,
            TURN,
            CRUISE,
            STOPPED,
        )
        self.constants = Constants(
            torch.tensor([p.blocked, -0.1 * p.blocked]),
            comparison,
            torch.tensor([p.hidden_weight, p.floor_weight, p.range_weight]),
            *(torch.tensor(float(value)) for value in numbers),
        )

    def forward(
        self, cells: Tensor, ranges: Ranges, pose: Pose, driven: Command, state: RangingState | None = None
    ) -> tuple[Command, RangingState]:
        p = self.params.floor
        shape = (*pose.x.shape, 2, p.bands, p.blocks)
        if pose.x.ndim < 1 or tuple(cells.shape) != shape or ranges.x.shape[:-1] != pose.x.shape:
            raise InputError(
                f"expected poses [..., T], cells [..., T, 2, {p.bands}, {p.blocks}] and ranges [..., T, n], got "
                f"{tuple(pose.x.shape)}, {tuple(cells.shape)} and {tuple(ranges.x.shape)}"
            )
        if driven.speed.shape != pose.x.shape or driven.curvature.shape != pose.x.shape:
            raise InputError(f"expected what was driven on the way to each pose, got {tuple(driven.speed.shape)}")
        if state is None:
            state = self.start(Pose(*(part[..., 0] for part in pose)))
        places, valid = torch.stack((ranges.x, ranges.y), -2), ranges.valid
        commands = []
        for t in range(pose.x.shape[-1]):
            here = Pose(*(part[..., t] for part in pose))
            moved = Command(driven.speed[..., t], driven.curvature[..., t])
            command, state = self.step(
                cells[..., t, :, :, :], places[..., t, :, :], valid[..., t, :], here, moved, state
            )
            commands.append(command)
        speed, curvature = zip(*commands, strict=True)
        return Command(torch.stack(speed, -1), torch.stack(curvature, -1)), state

    def start(self, pose: Pose) -> RangingState:
        """The state of a car that stands at a pose and knows nothing."""
        blank = torch.zeros_like(pose.x)
        level = blank.new_zeros(*blank.shape, self.params.floor.bands)
        floor = FloorState(level, blank, blank)
        patch = empty_patch(pose, self.params.patch)
        return RangingState(floor, patch, blank + SUPPRESSED, blank, blank + 1, blank, blank, blank, blank)

    def step(
        self, cells: Tensor, ranges: Tensor, valid: Tensor, pose: Pose, driven: Command, state: RangingState
    ) -> tuple[Command, RangingState]:
        """One frame: look, remember, measure the free arcs, decide.

        Args:
            cells: `[..., 2, bands, blocks]`.
            ranges: places in the body frame `[..., 2, n]`, m, and which of them are `valid` `[..., n]`.
            pose, driven: where the car is, and what it drove to get there, `[...]`.
        """
        c, batch = self.constants, pose.x.shape
        seen, floor = floor_step(cells, driven.speed, driven.curvature, state.floor, self.floor)
        keep = torch.where(state.mode == c.stopped, c.fade, c.keep)
        patch = move_patch(state.patch, pose, self.numbers, keep, self.params.patch)
        weights = c.evidence
        inside = valid & (ranges.abs().amax(-2) < c.reach)
        places = torch.cat((ranges, self.places.expand(*batch, *self.places.shape)), -1)
        number = cell_numbers(places, pose, self.params.patch)
        found = inside * weights[2]
        cell = (seen.ends * weights[0] - seen.free * weights[1]).flatten(-3)
        weight = torch.cat((found, cell, self.under.expand(*batch, -1)), -1)
        marked = found.shape[-1] + self.marked
        patch = add_evidence(patch, number[..., :marked], weight, self.params.patch)
        lengths = free_travel(patch.evidence.gather(-1, number[..., marked:]), self.arcs, c.limits)
        return self.decide(lengths, driven, floor, patch, state)

    def decide(
        self, lengths: Tensor, driven: Command, floor: FloorState, patch: Patch, state: RangingState
    ) -> tuple[Command, RangingState]:
        """The next mode and its command.

        Args:
            lengths: of the arcs, first to what blocks them and then to what is not known, `[..., 2, 8]`, m.
        """
        c = self.constants
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
        swing = torch.where(reversing, state.swing, (swing_back > c.swing).to(side.dtype))
        # Only a car that cannot go ahead at all backs into what it has not seen.
        straight_back = torch.where(blocked, free[..., 6], confined[..., 6])
        rear = torch.where(swing > c.zero, swing_back, straight_back)
        # Before a turn into what was not seen free the car backs once, if it knows that it can.
        unseen = (longest < c.least) & (rear >= c.swing) & (state.bold < c.one)
        gone = torch.where(reversing, state.gone - driven.speed * c.metres, c.zero)
        age = state.age + c.one
        facts = (  # in the order of `Facts`
            floor.age < self.floor.learning,
            straight < c.turn_at,
            (straight >= c.go_at) & (age >= c.turn_steps),
            blocked | unseen,
            (gone >= c.reverse_length) | (rear < c.rear),
            (gone >= c.reversed) & (longest >= c.room),
            rear < c.rear,
        )
        code = torch.stack(facts, -1).to(self.powers.dtype) @ self.powers
        mode = look_up(self.table, code + state.mode * self.facts).to(side.dtype)
        # Once tight, a turn stays tight until its arc is long.
        roomy = (wide >= c.wide_needs).to(side.dtype)
        row = mode * 4 + roomy * 2 + swing
        stands = floor.age <= self.floor.standing
        speed = torch.where(stands, c.zero, look_up(self.speeds, row))
        age = torch.where(mode == state.mode, age, c.zero)
        bold = torch.where(mode == c.reverse, c.one, torch.where(mode == c.cruise, c.zero, state.bold))
        command = Command(speed, look_up(self.bends, row) * side)
        return command, RangingState(floor, patch, mode, age, side, swing, gone, bold, difference)

    def mode(self, state: RangingState) -> Tensor:
        """What the car is doing, `[...]`: `CRUISE`, `TURN`, `REVERSE`, `SUPPRESSED` (the start), `STOPPED`."""
        return state.mode


def look_up(table: Tensor, number: Tensor) -> Tensor:
    """Entries of a table `[n]` at whole numbers of any shape. A single one is looked up as a row, so that it is
    not taken for a number known beforehand when the step is compiled."""
    return table[number.long().unsqueeze(-1)].squeeze(-1)
