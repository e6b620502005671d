"""Driving along a way: which place is reached, where to aim, and the arc that leads there."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from ndtorch.navigation.planning.costmap import LocalMap
from ndtorch.navigation.planning.params import PlannerParams
from ndtorch.navigation.planning.path_tracking import SpeedLimits, pure_pursuit, seen_length, seen_points, speed_profile
from ndtorch.navigation.planning.planner import Plan

WAY = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 1.0],
        [0.2, 0.0, 0.1, 0.5, 1.0],
        [0.4, 0.03, 0.3, 1.0, 1.0],
        [0.58, 0.12, 0.6, 1.5, 1.0],
        [0.42, 0.02, 0.4, 1.0, -1.0],
        [0.2, -0.04, 0.2, 1.0, -1.0],
    ],
    np.float32,
)
WIDE = 99.0
"""A largest curvature that limits nothing."""


def along(places: list[tuple[float, float]], length: float, heading: float, direction: float) -> tuple[float, float]:
    """The place so far along a broken line, and straight on beyond its end."""
    for (x, y), (to_x, to_y) in itertools.pairwise(places):
        piece = math.hypot(to_x - x, to_y - y)
        if length <= piece:
            return x + length / piece * (to_x - x), y + length / piece * (to_y - y)
        length -= piece
    x, y = places[-1]
    return x + length * direction * math.cos(heading), y + length * direction * math.sin(heading)


def arc_to(pose: tuple[float, float, float], place: tuple[float, float]) -> float:
    """Curvature of the circle that touches the heading and goes through a place: sine law, 2 sin(angle) / distance."""
    dx, dy = place[0] - pose[0], place[1] - pose[1]
    return 2 * math.sin(math.atan2(dy, dx) - pose[2]) / math.hypot(dx, dy)


@pytest.mark.parametrize("ahead", [0.1, 0.3, 0.45, 0.8])
@pytest.mark.parametrize("pose", [(0.01, 0.02, 0.1), (0.1, -0.05, -0.3), (0.3, 0.1, 0.2), (0.42, 0.0, 0.5)])
def test_it_aims_at_the_place_so_far_ahead_along_the_way(pose: tuple[float, float, float], ahead: float) -> None:
    aim = pure_pursuit(WAY, 0, pose, ahead, WIDE)
    left = [(float(x), float(y)) for x, y in WAY[aim.at + 1 : 4, :2]]
    aimed = along([pose[:2], *left], ahead, float(WAY[3, 2]), 1.0)
    assert aim.direction == 1.0
    assert aim.curvature == pytest.approx(arc_to(pose, aimed), abs=1e-4)
    lengths = [math.dist(a, b) for a, b in zip([pose[:2], *left], left, strict=False)]
    assert aim.left == pytest.approx(sum(lengths), abs=1e-6)


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize(("before", "reached"), [(0.021, 0), (0.019, 1), (-0.1, 1)])
def test_a_place_is_reached_2_cm_before_the_line_across_the_way(before: float, reached: int, direction: float) -> None:
    """The line is at right angles to the heading there, wherever aside the car is."""
    turned = 0.5
    cos, sin = math.cos(turned), math.sin(turned)
    way = np.array([[direction * 0.2 * n * cos, direction * 0.2 * n * sin, turned, 0, direction] for n in range(4)])
    for aside in (0.3, -0.3):
        x = direction * (0.2 - before)
        pose = (x * cos - aside * sin, x * sin + aside * cos, turned)
        assert pure_pursuit(way, 0, pose, 0.3, WIDE).at == reached


def test_beyond_the_end_of_a_stretch_the_next_one_begins_and_beyond_the_last_none() -> None:
    aim = pure_pursuit(WAY, 0, (0.6, 0.13, 0.6), 0.3, WIDE)
    assert (aim.direction, aim.at) == (-1.0, 3)
    assert pure_pursuit(WAY, 0, (0.1, -0.06, 0.2), 0.3, WIDE).direction == 1.0
    done = pure_pursuit(WAY, 3, (0.1, -0.06, 0.2), 0.3, WIDE)
    assert (done.direction, done.at, done.left) == (0.0, 5, 0.0)


LIMITS = SpeedLimits(0.5, 0.35, 0.2, 1.5)


def test_the_speed_before_what_is_slow_is_what_can_be_braked_from():
    """v^2 = v'^2 + 2 a s from place to place, and standing where the direction changes."""
    limits, blocked = LIMITS._replace(deceleration=0.1), np.zeros((60, 60), bool)
    around = LocalMap(blocked, ~blocked, -1.0, -1.0, 0.05)
    x = [0.0, 0.2, 0.5, 0.6, 0.7]
    way = np.array([[v, 0.0, 0.0, 0.0, 1.0] for v in x], np.float32)
    seen = np.zeros((60, 60), np.float32)
    way[3:, 4] = -1.0
    speeds = speed_profile(Plan(way, 1.0, seen + 9, seen, seen), around, limits, PlannerParams())
    back = limits.reverse
    begun = [math.sqrt(0.2 * 0.5), math.sqrt(0.2 * 0.3), math.sqrt(back**2 + 0.2 * 0.1), back, back]
    assert speeds.tolist() == pytest.approx(begun, abs=1e-5)


def test_a_path_is_seen_up_to_where_the_leading_disc_covers_unknown_cells():
    blocked = np.zeros((60, 60), bool)
    around = LocalMap(blocked, ~blocked, -1.0, -1.0, 0.05)
    way = np.array([[v, 0.0, 0.0, 0.0, 1.0] for v in (0.0, 0.2, 0.5, 0.6, 0.7)], np.float32)
    seen = np.zeros((60, 60), np.float32)
    unseen = seen.copy()
    unseen[:, round((0.65 + 0.2 + 1) / 0.05) :] = 1  # where a disc .1875 m ahead of the last place covers unknown cells
    assert seen_points(Plan(way, 1.0, seen + 9, seen, seen), around, PlannerParams()) == 5
    assert seen_points(Plan(way, 1.0, seen + 9, unseen, seen), around, PlannerParams()) == 4
    assert seen_length(way, 0, 5, (0.1, 0.0, 0.0)) == math.inf
    assert seen_length(way, 0, 4, (0.1, 0.0, 0.0)) == pytest.approx(0.5)
    assert seen_length(way, 2, 2, (0.5, 0.0, 0.0)) == 0
