"""Buildings of points and drives through them, for tests of the localiser."""

import math

import numpy as np
import torch

from ndtorch.navigation import Pose
from ndtorch.navigation.localisation import Localiser, LocaliserParams
from ndtorch.navigation.localisation.ndt import Scan, add_scan, empty_map
from ndtorch.navigation.localisation.state import frame_pose
from ndtorch.navigation.odometry import arc

PARAMS = LocaliserParams()
DT, SPEED, TURN = 0.2, 0.5, 0.9
SIDES = (7.0, 3.5)
"""Straight parts of a round, between bends of the radius 1 / TURN."""

CORNERS = np.array([(-3, -2.4), (2.6, -2.4), (2.6, 1.2), (1.4, 2.2), (-3, 2.2)], float)
"""A room with one oblique wall."""


def pose_of(values):
    return Pose(*(torch.tensor(float(value), dtype=torch.float64) for value in values))


def sampled(ends):
    """Points on lines between pairs of ends."""
    return np.concatenate([np.linspace(a, b, int(20 * math.dist(a, b)) + 2) for a, b in ends])


def building(seed):
    """Points on the walls of a building of 9 x 6 m with a dozen oblique screens in it, `[n, 2]`."""
    rng = np.random.default_rng(seed)
    ends = [((0, 0), (9, 0)), ((9, 0), (9, 6)), ((9, 6), (0, 6)), ((0, 6), (0, 0))]
    for _ in range(12):
        x, y, turn = rng.uniform(0.5, 8.5), rng.uniform(0.5, 5.5), rng.uniform(0, math.pi)
        ends.append(((x, y), (x + math.cos(turn), y + math.sin(turn))))
    points = sampled(ends)
    return points + rng.normal(0, 0.005, points.shape)


def corridor():
    """Ends of walls `[n, 2, 2]` to both sides of a round, with oblique screens along them."""
    radius, (length, width) = 1 / TURN, SIDES
    rng, ends = np.random.default_rng(5), []
    for out in (0.9, -0.75):
        left, bottom = -radius - out, -out
        right, top = length + radius + out, width + 2 * radius + out
        corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
        ends += list(zip(corners, corners[1:] + corners[:1], strict=True))
    for k in range(4):
        (ax, ay), (bx, by) = ends[k]
        for share in np.arange(0.08, 1.0, 0.09):
            x, y, turn = ax + share * (bx - ax), ay + share * (by - ay), rng.uniform(0, math.pi)
            ends.append(((x, y), (x + 0.25 * math.cos(turn), y + 0.25 * math.sin(turn))))
    return np.array(ends)


def map_of(points):
    """The NDT map of points of the world."""
    return add_scan(
        empty_map(PARAMS.map_cells), Scan(*points.T.copy(), np.ones(len(points))), np.zeros(3), PARAMS.cell_m
    )


def rounds(count):
    """Speeds and curvatures of rounds of the corridor."""
    bend = [(SPEED, TURN)] * round(math.pi / 2 / TURN / SPEED / DT)
    sides = [[(SPEED, 0.0)] * round(side / SPEED / DT) for side in SIDES]
    return (sides[0] + bend + sides[1] + bend) * (2 * count)


def path(driven, scale=0.0, bend=0.0, drift=0.0):
    """Poses of a drive by an odometer with errors."""
    found = [(0.0, 0.0, 0.0)]
    for speed, curvature in driven:
        turn = speed * curvature * (1 + bend) + drift
        found.append(arc(Pose(*found[-1]), speed * (1 + scale), turn / speed / (1 + scale), DT))
    return np.array(found)


class PointLocaliser(Localiser):
    """A localiser that ranges the points ahead of its true pose, through walls, whatever the rows show.

    Args:
        count: points of a scan, with a standard deviation of a centimetre; None for every sixth of them, exactly.
    """

    def __init__(self, rig, dt, points, params=PARAMS, known=None, count=None):
        super().__init__(rig, dt, params, known)
        self.points, self.count, self.true, self.rng = points, count, np.zeros(3), np.random.default_rng(0)

    def scan(self, rows):
        x, y, heading = self.true
        offset = self.points - (x, y)
        ahead = math.cos(heading) * offset[:, 0] + math.sin(heading) * offset[:, 1]
        aside = math.cos(heading) * offset[:, 1] - math.sin(heading) * offset[:, 0]
        seen = (ahead > 0.9) & (ahead < 5) & (np.abs(aside) < 0.75 * ahead)
        ahead, aside = ahead[seen][::6], aside[seen][::6]
        if self.count is not None:
            pick = self.rng.permutation(len(ahead))[: self.count]
            noise = self.rng.normal(0, 0.01, (2, len(pick)))
            ahead, aside = ahead[pick] + noise[0], aside[pick] + noise[1]
        return Scan(ahead, aside, np.ones(len(ahead)))

    def drive(self, true, reckoned, state=None):
        """Poses found `[T, 3]`, the poses in frames, and the states of a drive."""
        found, frames, states = [], [], []
        for here, there in zip(true, reckoned, strict=True):
            self.true = here
            state = self(torch.zeros(2, 8) if self.due(state) else None, pose_of(there), state)
            found.append(state.pose)
            frames.append(frame_pose(state))
            states.append(state)
        return np.array(found), frames, states
