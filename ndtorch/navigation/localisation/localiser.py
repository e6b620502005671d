"""Where the car is: dead reckoning, corrected by fitting what is ranged to what was ranged before."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from ndtorch.errors import InputError
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
        way, turned: metres driven and radians turned since the last scan, both without sign.
        scale, drift: of the odometer, as far as known: the share by which it counts too much way, and the radians
            that it adds to the heading each second of driving.
        age: steps since the start.
        score: how well the last scan fitted, 0..1.
    """

    walls: Tensor
    pose: Pose
    reckoned: Pose
    way: Tensor
    turned: Tensor
    scale: Tensor
    drift: Tensor
    age: Tensor
    score: Tensor


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

    Raises:
        InputError: Numba is not installed; several cars at once.
    """

    def __init__(self, rig: StereoRig, dt: float, params: LocaliserParams | None = None) -> None:
        super().__init__()
        need("numba", "localise")
        self.rig, self.dt, self.params = rig, dt, params or LocaliserParams()
        self.every = max(1, round(self.params.every / dt))
        self.settle = self.params.settle / dt

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
        return state._replace(age=state.age + 1)

    def start(self, at: Pose) -> LocaliserState:
        """A car at a pose that has ranged nothing yet."""
        pose, zero = Pose(*(number(float(part)) for part in at)), number(0.0)
        return LocaliserState(empty_walls(self.params), pose, pose, zero, zero, zero, zero, zero, zero)

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
        true_turn = turn - float(state.drift) * self.dt
        here = float(state.pose.heading)
        direction = here + aside + (true_turn - turn) / 2
        pose = Pose(
            number(float(state.pose.x) + length * math.cos(direction)),
            number(float(state.pose.y) + length * math.sin(direction)),
            number(here + true_turn),
        )
        there = Pose(number(x), number(y), number(heading))
        return state._replace(pose=pose, reckoned=there, way=state.way + length, turned=state.turned + abs(true_turn))

    def look(self, rows: Tensor, state: LocaliserState) -> LocaliserState:
        """Fit what is ranged now to the walls, correct the pose, and add it to them."""
        scan = self.scan(rows)
        if len(scan.x) < 3:
            return state
        p = self.params
        x, y, heading = map(float, state.pose)
        if float(state.age) >= self.settle:
            way, turned = float(state.way), float(state.turned)
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
        way, gain = float(state.way), self.params.gain
        if way < 1e-3:
            return state
        heading = float(state.pose.heading) + turn
        ahead = x * math.cos(heading) + y * math.sin(heading)
        drift = float(state.drift) - gain * turn / (self.every * self.dt)
        scale = float(state.scale) - gain * ahead / way
        return state._replace(
            drift=number(min(max(drift, -WORST_DRIFT), WORST_DRIFT)),
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
