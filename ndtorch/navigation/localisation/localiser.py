"""Where the car is: dead reckoning, corrected by fitting what is ranged to what was ranged before."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor, nn

from ndtorch.arguments import check_state
from ndtorch.errors import InputError
from ndtorch.navigation.localisation.agreeing import settled
from ndtorch.navigation.localisation.filter import predicted, updated
from ndtorch.navigation.localisation.finding import Hunt, begin, carried_over, draw, no_hunt, refine, verdict, vote
from ndtorch.navigation.localisation.fitting import fit_pair
from ndtorch.navigation.localisation.graph import carried, seen_from
from ndtorch.navigation.localisation.motion import look_of, motion_seen
from ndtorch.navigation.localisation.params import LocaliserParams
from ndtorch.navigation.localisation.parts import (
    Parts,
    add_to_part,
    begun_at,
    finish,
    is_ripe,
    no_parts,
    redrawn,
    with_frame,
)
from ndtorch.navigation.localisation.scanning import scan_rows
from ndtorch.navigation.localisation.state import LocaliserState, Trail, floats, fresh, less_sure, number, odometer_of
from ndtorch.navigation.localisation.trail import driven_on, gone_through, is_due, no_trail, scan_of, with_scan
from ndtorch.navigation.localisation.walls import Scan, add_scan, empty_walls, fit_scan
from ndtorch.navigation.localisation.way import drive_on
from ndtorch.navigation.localisation.wheels import are_known, carried_to, corrected, looked, no_wheels, rolled
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.rig import StereoRig

WORST_SCALE, WORST_DRIFT = 0.2, math.radians(2.0)
"""No odometer is believed to be worse: as a share of the way, and in radians a second."""

QUICKER = 6
"""The way since the start is gone through again so many times as fast as it was driven, or nearly."""


class Localiser(nn.Module):
    """Corrects dead reckoning by landmarks: the ranges of both rows, fitted to all that was ranged before.

    A few times a second both rows are searched for ranges, and for what was ranged in the look before, which tells how
    the car moved since then even where its wheels slip (`motion`, `wheels`). The scan is fitted to the walls by
    Gauss-Newton, begun where this has led, and an extended Kalman filter weighs what the fit says of the pose and of
    the scale, bend and drift that are left (`filter`). Then the scan becomes part of the walls. Every few metres a part
    of the building is finished and fitted to the parts it overlaps, one of them a step; then all parts are moved to
    where they agree, and the car with them (`parts`). After the first minutes the way since the start is gone through
    again (`trail`), a scan a step. A loop is closed where the error of the round is less than about a cell and a half;
    there is no search for loops beyond that.

    Called once a frame, `state = localiser(rows, reckoned, state)`. One car at a time, on the CPU, without gradients.

    Shapes:
        rows: both gray rows, `[2, W]`, 0..1, or None where it is not `due`; reckoned: `Pose` of `[]`.
        `state=None` starts at the reckoned pose with nothing ranged yet.

    Args:
        rig: the camera pair.
        dt: time step, s.
        params: its numbers.
        known: walls of a map that was made before, `[size, size, 6]`. The car then does not know where it is: it drives
            in a frame of its own until what it has ranged fits one place of the map and no other.

    Raises:
        InputError: several cars at once; walls of another size.
    """

    def __init__(
        self, rig: StereoRig, dt: float, params: LocaliserParams | None = None, known: Tensor | None = None
    ) -> None:
        super().__init__()
        self.rig, self.dt, self.params = rig, dt, params or LocaliserParams()
        self.every = max(1, round(self.params.every / dt))
        self.settle = self.params.settle / dt
        size = self.params.size
        if known is not None and known.shape != (size, size, 6):
            raise InputError(f"known walls must be [{size}, {size}, 6], got {tuple(known.shape)}")
        self.known = known
        self.picture = None if known is None else draw(known, self.params)

    def warm_up(self) -> None:
        """Have the kernels ready that it uses once it has seen something."""
        ahead = np.linspace(1.0, 2.0, 8)
        wall, here = Scan(ahead, ahead - 1.5, np.ones_like(ahead)), (0.0, 0.0, 0.0)
        walls = add_scan(empty_walls(self.params), wall, here, self.params)
        fit_scan(walls, wall, here, (0.1, 0.1), self.params)
        before = look_of(torch.zeros(2, self.rig.width), wall)
        motion_seen(before, before.rows, (0.0, 0.0), self.rig, self.params.motion)
        redrawn(add_to_part(no_parts(here, self.params), wall, here, self.params), self.dt, self.params)
        if self.picture is not None:
            pattern = torch.from_numpy(np.stack((wall.x, wall.y), -1))
            vote(no_hunt()._replace(pattern=pattern, turn=number(0.0)), self.picture, self.params)

    def due(self, state: LocaliserState | None) -> bool:
        """Whether the next step looks at its rows."""
        return state is None or int(state.age) % self.every == 0

    def forward(self, rows: Tensor | None, reckoned: Pose, state: LocaliserState | None = None) -> LocaliserState:
        check_state(state, LocaliserState)
        if reckoned.x.ndim or (rows is not None and rows.ndim != 2):
            raise InputError(f"localise knows one car at a time, got poses {tuple(reckoned.x.shape)}")
        due = self.due(state)
        if state is None:
            state = self.start(reckoned)
        state = state._replace(wheels=rolled(state.wheels, reckoned, self.dt))
        state = self.move(state, corrected(state.wheels))
        if due:
            if rows is None:
                raise InputError("this step looks at the rows, see `due`, but there are none")
            state = self.look(rows, state)
        if state.hunt is not None:
            state = self.find(state, state.hunt)
        elif not due or self.every == 1:
            if state.parts is not None and len(state.parts.pairs):
                state = self.arrange(state, state.parts)
            for _ in range(math.ceil(QUICKER / self.every)):
                state = state if state.trail is None else self.retrace(state, state.trail)
        return state._replace(age=state.age + 1)

    def retrace(self, state: LocaliserState, trail: Trail) -> LocaliserState:
        """Go through the trail again where it is time to, one scan or one pair of parts on."""
        p, again = self.params.retrace, trail.again
        if again is None:
            return state._replace(trail=trail._replace(again=self.anew(state, trail))) if is_due(trail, p) else state
        assert again.parts is not None
        if len(again.parts.pairs):
            again = self.arrange(again, again.parts)
        elif int(trail.reached) < len(trail.entries):
            entry = trail.entries[int(trail.reached)]
            again = self.move(again._replace(age=entry.age), entry.reckoned, float(entry.seconds), entry.unsure)
            again = self.absorb(again, scan_of(entry), True)
            trail = trail._replace(reached=trail.reached + 1)
        else:
            again = self.move(again, state.reckoned, float(trail.seconds))
            return again._replace(age=state.age, wheels=state.wheels, trail=gone_through(trail, p))
        return state._replace(trail=trail._replace(again=again))

    def anew(self, state: LocaliserState, trail: Trail) -> LocaliserState:
        """A car where the trail begins that knows the odometer as it is known now."""
        doubt = torch.zeros_like(state.doubt)
        doubt[3:, 3:] = state.doubt[3:, 3:] * self.params.retrace.widen**2
        again = self.start(trail.entries[0].reckoned)
        assert again.parts is not None
        # Only the first part, begun in the first step, still has nothing that it could be fitted to.
        parts = again.parts._replace(learning=number(self.dt))
        again = again._replace(scale=state.scale, bend=state.bend, drift=state.drift, doubt=doubt, wheels=state.wheels)
        return again._replace(parts=parts, trail=None)

    def arrange(self, state: LocaliserState, parts: Parts) -> LocaliserState:
        """Fit the next pair of parts; after the last one all are moved to where they fit, and the car with them."""
        parts = fit_pair(parts, self.params)
        if len(parts.pairs):
            return state._replace(parts=parts)
        before = parts.poses[-1].numpy()
        parts = settled(parts, *odometer_of(state), self.params)
        x, y, heading = carried(parts.poses[-1].numpy(), seen_from(before, np.array([float(v) for v in state.pose])))
        # Headings are counted on beyond a turn.
        heading += 2 * math.pi * round((float(state.pose.heading) - heading) / (2 * math.pi))
        pose = Pose(number(x), number(y), number(heading))
        return state._replace(parts=parts, pose=pose, walls=redrawn(parts, self.dt, self.params))

    def find(self, state: LocaliserState, hunt: Hunt) -> LocaliserState:
        """One step of the search for the place in the known map."""
        p, pose = self.params, (float(state.pose.x), float(state.pose.y), float(state.pose.heading))
        assert self.known is not None
        assert self.picture is not None
        if int(hunt.turn) < 0:  # between two searches
            return state._replace(hunt=begin(hunt, state.walls, pose, p) if float(hunt.way) > p.finding.way else hunt)
        if int(hunt.turn) < p.finding.turns:
            return state._replace(hunt=vote(hunt, self.picture, p))
        if len(hunt.places):
            return state._replace(hunt=refine(hunt, self.known, p))
        found = verdict(hunt, p)
        if found is None:
            return state._replace(hunt=no_hunt()._replace(way=hunt.way))
        return state._replace(walls=self.known, pose=Pose(*map(number, carried_over(hunt, found, pose))), hunt=None)

    def start(self, at: Pose) -> LocaliserState:
        """A car at a pose that has ranged nothing yet."""
        pose, zero, p = Pose(*(number(float(part)) for part in at)), number(0.0), self.params
        hunt = None if self.known is None else no_hunt()
        doubt = torch.diag(number(1.0).new_tensor([0.0, 0.0, 0.0, p.scale, p.bend, p.drift]).square())
        parts = no_parts(floats(pose), self.params) if self.known is None else None
        trail = no_trail() if self.known is None and self.params.retrace.after else None
        wheels, walls = no_wheels(pose, self.params.motion), empty_walls(self.params)
        known = (zero, zero, zero, doubt, zero, zero, hunt, parts, trail)
        return LocaliserState(walls, pose, pose, zero, zero, doubt[0, :2], wheels, *known)

    def put(self, state: LocaliserState, at: Pose) -> LocaliserState:
        """The state of a car that was carried to a pose, and has been told so."""
        pose = Pose(*(number(float(part)) for part in at))
        parts, wheels = state.parts and begun_at(state.parts, floats(pose), state.age), carried_to(state.wheels, pose)
        return fresh(state._replace(pose=pose, reckoned=pose, wheels=wheels, parts=parts, trail=None))

    def move(
        self, state: LocaliserState, reckoned: Pose, seconds: float | None = None, unsure: Tensor | None = None
    ) -> LocaliserState:
        """Drive on by what dead reckoning says, corrected by what is known of it.

        Args:
            seconds: of driving, a time step by default.
            unsure: variances of way and turn since the last look, `[2]`, to be counted now.
        """
        seconds = self.dt if seconds is None else seconds
        state = state if unsure is None else less_sure(state, unsure)
        x, y, heading = map(float, reckoned)
        ox, oy, before = map(float, state.reckoned)
        length, turn = math.hypot(x - ox, y - oy), heading - before
        if length < 1e-6 and abs(turn) < 1e-9:
            return state
        aside = math.atan2(y - oy, x - ox) - before  # of the chord, from where the car headed
        length *= 1 - float(state.scale)
        true_turn = (turn - float(state.drift) * seconds) * (1 - float(state.bend))
        here = float(state.pose.heading)
        direction = here + aside + (true_turn - turn) / 2
        pose = Pose(
            number(float(state.pose.x) + length * math.cos(direction)),
            number(float(state.pose.y) + length * math.sin(direction)),
            number(here + true_turn),
        )
        there = Pose(number(x), number(y), number(heading))
        hunt = state.hunt if state.hunt is None else state.hunt._replace(way=state.hunt.way + length)
        parts = state.parts
        if parts is not None:
            odometer = (float(state.scale), float(state.bend), float(state.drift))
            step = (math.hypot(x - ox, y - oy), aside, turn)
            parts = parts._replace(driven=drive_on(parts.driven, step, seconds, odometer))
        trail = None if state.trail is None else driven_on(state.trail, length, seconds)
        way, turned = state.way + length, state.turned + true_turn
        return state._replace(pose=pose, reckoned=there, way=way, turned=turned, hunt=hunt, parts=parts, trail=trail)

    def look(self, rows: Tensor, state: LocaliserState) -> LocaliserState:
        """Range what the rows show, keep it for later, and correct the pose by it."""
        wheels, unsure = looked(state.wheels, rows, self.rig, self.params.motion)
        state = self.move(state, corrected(wheels), 0.0, unsure)
        scan, trail = self.scan(rows), state.trail
        state = state._replace(wheels=wheels._replace(look=look_of(rows, scan)))
        scan = Scan(*(part[scan.weight > 0] for part in scan))
        if float(state.age) >= self.settle and not float(state.way) and not float(state.turned):
            return state  # it stands, and has seen the same before
        keep = trail is not None and (float(trail.seconds) > 0 or float(state.age) < self.settle)
        if trail is not None and keep:
            state = state._replace(trail=with_scan(trail, scan, state.age, state.reckoned, unsure))
        return self.absorb(state, scan, keep)

    def absorb(self, state: LocaliserState, scan: Scan, keep: bool = False) -> LocaliserState:
        """Fit a scan to the walls, correct the pose, and add it to them; keep a frame for it, too, where wanted."""
        if len(scan.x) < 3 and not keep:
            return state
        if len(scan.x) < 3:
            assert state.parts is not None
            return state._replace(parts=with_frame(state.parts, floats(state.pose), state.age))
        p = self.params
        if float(state.age) >= self.settle:
            state = self.correct(state, scan)
        x, y, heading = floats(state.pose)
        pose = Pose(number(x), number(y), number(heading))
        parts = state.parts
        if parts is not None:
            parts = add_to_part(parts, scan, (x, y, heading), p)
            parts = with_frame(parts, (x, y, heading), state.age) if keep else parts
            if is_ripe(parts, p) and not len(parts.pairs):
                parts = finish(parts, (x, y, heading), state.age, self.dt, *odometer_of(state), p)
        return fresh(state._replace(walls=add_scan(state.walls, scan, (x, y, heading), p), pose=pose, parts=parts))

    def correct(self, state: LocaliserState, scan: Scan) -> LocaliserState:
        """The pose, and what is known of the odometer, after a scan: one step of an extended Kalman filter."""
        p, start, way, turned = self.params, np.array(floats(state.pose)), float(state.way), float(state.turned)
        seconds = self.every * self.dt if way > 1e-3 else 0.0
        before, unsure, known = state.doubt.numpy(), state.unsure.numpy(), are_known(state.wheels, p.motion)
        doubt = predicted(before, way, turned, unsure, seconds, start[2], p, known)
        place, angle = p.reach * np.sqrt(doubt[[0, 1], [0, 1]].max()), p.reach * np.sqrt(doubt[2, 2])
        fit = fit_scan(state.walls, scan, tuple(start.tolist()), (place + p.floor, angle + p.turn_floor), p)
        if fit.score < p.worst:
            return state._replace(doubt=torch.from_numpy(doubt), score=number(fit.score))
        off = np.array((fit.x, fit.y, fit.heading)) - start
        change, doubt = updated(doubt, off, fit.information, p)
        x, y, heading = start + change[:3]
        scale, bend, drift = np.array((float(state.scale), float(state.bend), float(state.drift))) + change[3:]
        return state._replace(
            pose=Pose(number(x), number(y), number(heading)),
            scale=number(min(max(scale, -WORST_SCALE), WORST_SCALE)),
            bend=number(min(max(bend, -WORST_SCALE), WORST_SCALE)),
            drift=number(min(max(drift, -WORST_DRIFT), WORST_DRIFT)),
            doubt=torch.from_numpy(doubt),
            score=number(fit.score),
        )

    def scan(self, rows: Tensor) -> Scan:
        """What is ranged in both rows; what is too near or too far to count weighs nothing."""
        return scan_rows(rows, self.rig, self.params)
