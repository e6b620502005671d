"""Where the car is: dead reckoning, corrected by fitting what is ranged to what was ranged before."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from ndtorch.errors import InputError
from ndtorch.navigation.localisation.finding import Hunt, begin, carried_over, draw, no_hunt, refine, verdict, vote
from ndtorch.navigation.localisation.params import LocaliserParams
from ndtorch.navigation.localisation.walls import Scan, add_scan, empty_walls, fit_scan
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.ranging import triangulate
from ndtorch.navigation.rig import StereoRig
from ndtorch.navigation.row_search import search_rows
from ndtorch.optional import need

WORST_SCALE, WORST_DRIFT = 0.2, math.radians(2.0)
"""No odometer is believed to be worse: as a share of the way, and in radians a second."""


class LocaliserState(NamedTuple):
    """State of `Localiser`; single numbers are float64 tensors `[]`.

    Attributes:
        walls: what was ranged, `[size, size, 6]`, see `walls`.
        pose: where the car is.
        reckoned: where dead reckoning says that it is.
        way, turned: metres driven since the last scan, without sign, and radians turned, with it.
        scale, bend, drift: of the odometer, as far as known: the shares by which it counts too much way and too much
            turning, and the radians that it adds to the heading each second of driving.
        age, scans: steps and corrections since the start.
        score: how well the last scan fitted, 0..1.
        hunt: the search for the place in a known map; None where there is none, or where it has been found.
    """

    walls: Tensor
    pose: Pose
    reckoned: Pose
    way: Tensor
    turned: Tensor
    scale: Tensor
    bend: Tensor
    drift: Tensor
    age: Tensor
    scans: Tensor
    score: Tensor
    hunt: Hunt | None = None


class Localiser(nn.Module):
    """Corrects dead reckoning by landmarks: the ranges of both rows, fitted to all that was ranged before.

    A few times a second both rows are searched for ranges up to some metres. The scan is fitted to the walls by
    Gauss-Newton, begun where dead reckoning has led, which is corrected by the scale and the drift that former
    corrections have shown. Then the scan becomes part of the walls. A loop is closed by itself where the walls of the
    last round come into sight and the error of the round is less than about a cell and a half; the walls are
    never moved afterwards.

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
        InputError: Numba is not installed; several cars at once; walls of another size.
    """

    def __init__(
        self, rig: StereoRig, dt: float, params: LocaliserParams | None = None, known: Tensor | None = None
    ) -> None:
        super().__init__()
        need("numba", "localise")
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
        if self.picture is not None:
            pattern = torch.from_numpy(np.stack((wall.x, wall.y), -1))
            vote(no_hunt()._replace(pattern=pattern, turn=number(0.0)), self.picture, self.params)

    def due(self, state: LocaliserState | None) -> bool:
        """Whether the next step looks at its rows."""
        return state is None or int(state.age) % self.every == 0

    def forward(self, rows: Tensor | None, reckoned: Pose, state: LocaliserState | None = None) -> LocaliserState:
        if reckoned.x.ndim or (rows is not None and rows.ndim != 2):
            raise InputError(f"localise knows one car at a time, got poses {tuple(reckoned.x.shape)}")
        due = self.due(state)
        if state is None:
            state = self.start(reckoned)
        state = self.move(state, reckoned)
        if due:
            if rows is None:
                raise InputError("this step looks at the rows, see `due`, but there are none")
            state = self.look(rows, state)
        if state.hunt is not None:
            state = self.find(state, state.hunt)
        return state._replace(age=state.age + 1)

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
        here = Pose(*map(number, carried_over(hunt, found, pose)))
        return state._replace(walls=self.known, pose=here, hunt=None)

    def start(self, at: Pose) -> LocaliserState:
        """A car at a pose that has ranged nothing yet."""
        pose, zero = Pose(*(number(float(part)) for part in at)), number(0.0)
        hunt = None if self.known is None else no_hunt()
        return LocaliserState(
            empty_walls(self.params), pose, pose, zero, zero, zero, zero, zero, zero, zero, zero, hunt
        )

    def put(self, state: LocaliserState, at: Pose) -> LocaliserState:
        """The state of a car that was carried to a pose, and has been told so."""
        pose = Pose(*(number(float(part)) for part in at))
        return state._replace(pose=pose, reckoned=pose, way=number(0.0), turned=number(0.0))

    def move(self, state: LocaliserState, reckoned: Pose) -> LocaliserState:
        """Drive on by what dead reckoning says, corrected by what is known of the odometer."""
        x, y, heading = map(float, reckoned)
        ox, oy, before = map(float, state.reckoned)
        length, turn = math.hypot(x - ox, y - oy), heading - before
        if length < 1e-6 and abs(turn) < 1e-9:
            return state
        aside = math.atan2(y - oy, x - ox) - before  # of the chord, from where the car headed
        length *= 1 - float(state.scale)
        true_turn = (turn - float(state.drift) * self.dt) * (1 - float(state.bend))
        here = float(state.pose.heading)
        direction = here + aside + (true_turn - turn) / 2
        pose = Pose(
            number(float(state.pose.x) + length * math.cos(direction)),
            number(float(state.pose.y) + length * math.sin(direction)),
            number(here + true_turn),
        )
        there = Pose(number(x), number(y), number(heading))
        hunt = state.hunt if state.hunt is None else state.hunt._replace(way=state.hunt.way + length)
        return state._replace(
            pose=pose, reckoned=there, way=state.way + length, turned=state.turned + true_turn, hunt=hunt
        )

    def look(self, rows: Tensor, state: LocaliserState) -> LocaliserState:
        """Fit what is ranged now to the walls, correct the pose, and add it to them."""
        scan = self.scan(rows)
        if len(scan.x) < 3:
            return state
        p = self.params
        x, y, heading = map(float, state.pose)
        if float(state.age) >= self.settle:
            way, turned = float(state.way), abs(float(state.turned))
            place = p.still + p.slip * way
            angle = p.turn_still + p.turn_slip * turned + p.turn_way * way
            fit = fit_scan(state.walls, scan, (x, y, heading), (place, angle), p)
            state = self.learn(state, fit.heading - heading, fit.x - x, fit.y - y)
            x, y, heading = fit.x, fit.y, fit.heading
            state = state._replace(score=number(fit.score))
        pose = Pose(number(x), number(y), number(heading))
        walls = add_scan(state.walls, scan, (x, y, heading), p)
        return state._replace(walls=walls, pose=pose, way=number(0.0), turned=number(0.0))

    def learn(self, state: LocaliserState, turn: float, x: float, y: float) -> LocaliserState:
        """What a correction says of the odometer: it is an integral controller of both errors."""
        p, way, scans = self.params, float(state.way), float(state.scans)
        if way < 1e-3:
            return state
        gain = max(p.gain, p.first_gain / (1 + scans / p.learning)) if p.gain else 0.0
        heading = float(state.pose.heading) + turn
        ahead = x * math.cos(heading) + y * math.sin(heading)
        turned, drift, bend = float(state.turned), float(state.drift), float(state.bend)
        if abs(turned) > p.bent:  # what is wrong in a bend is rather its angle
            bend -= gain * turn / turned
        else:
            drift -= gain * turn / (self.every * self.dt)
        scale = float(state.scale) - gain * ahead / way
        return state._replace(
            scans=number(scans + 1),
            drift=number(min(max(drift, -WORST_DRIFT), WORST_DRIFT)),
            bend=number(min(max(bend, -WORST_SCALE), WORST_SCALE)),
            scale=number(min(max(scale, -WORST_SCALE), WORST_SCALE)),
        )

    def scan(self, rows: Tensor) -> Scan:
        """What is ranged in both rows."""
        p = self.params
        ranges = triangulate(search_rows(rows.detach().cpu(), p.search), self.rig)
        x, y = (part[ranges.valid].double().numpy() for part in (ranges.x, ranges.y))
        distance = np.hypot(x, y)
        good = (distance > p.near) & (distance < p.far)
        x, y, distance = x[good], y[good], distance[good]
        return Scan(x, y, np.minimum(1.0, (p.full / np.maximum(distance, p.near)) ** 2))


def number(value: float) -> Tensor:
    """A single number of the state."""
    return torch.tensor(value, dtype=torch.float64)
