"""How fast the goal controller goes along its way: beside walls, into what was not seen, before what is slow."""

import math

import numpy as np
import pytest

from ndtorch.navigation.controllers.goal import GoalParams
from ndtorch.navigation.controllers.goal.memory import Surroundings
from ndtorch.navigation.controllers.goal.planning import Planned
from ndtorch.navigation.controllers.goal.speeds import allowed_speeds, speed_towards


def test_the_speed_towards_the_next_place_falls_as_it_is_neared():
    way = np.array([[0.0, 0.0, 0.0, 0.0, 1.0, 0.5], [0.3, 0.4, 0.0, 0.0, 1.0, 0.2], [0.3, 1.0, 0.0, 0.0, 1.0, 0.4]])
    for x, y in ((0.0, 0.4), (0.3, 0.39), (0.2, 0.2)):
        length = np.hypot(0.3 - x, 0.4 - y)
        wanted = min(0.5, np.sqrt(0.2**2 + 2 * 0.1 * length))
        assert speed_towards(way, 0, (x, y, 9.0), 0.1) == pytest.approx(wanted)
    # It stands where it changes its direction, and at the end of all its speed is the last one's.
    turned = way.copy()
    turned[2, 4] = -1.0
    assert speed_towards(turned, 0, (0.3, 0.39, 0.0), 0.1) == pytest.approx(0.08)
    assert speed_towards(way, 2, (0.3, 0.9, 0.0), 0.1) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("clear", "share"), [(0.6, 1.0), (0.45, 1.0), (0.345, 0.5), (0.24 + 0.021, 0.1), (0.24, 0.0), (0.1, 0.0)]
)
def test_speed_falls_with_the_room_beside_the_way(clear, share):
    """From the cruise speed where there is `soft` around the discs to `slow` where they just fit."""
    params, blocked = GoalParams(), np.zeros((40, 40), bool)
    around = Surroundings(blocked, ~blocked, -1.0, -1.0, 0.05)
    way = np.array([[0.0, 0.0, 0.0, 0.0, 1.0], [0.2, 0.0, 0.0, 0.0, 1.0]], np.float32)
    room, seen = np.full((40, 40), clear, np.float32), np.zeros((40, 40), np.float32)
    speeds = allowed_speeds(way, around, Planned(way, 1.0, room, seen, seen), params)
    wanted = params.slow + (params.speed - params.slow) * share
    assert speeds.tolist() == pytest.approx([wanted] * 2, abs=1e-5)
    # Into what was not seen it creeps, and backwards it is no faster than its other half.
    unseen = allowed_speeds(way, around, Planned(way, 1.0, room, seen + 1, seen), params)
    assert unseen.tolist() == pytest.approx([min(wanted, params.creep)] * 2, abs=1e-5)
    back = way * np.array([-1.0, 1.0, 1.0, 1.0, -1.0], np.float32)
    reverse = allowed_speeds(back, around, Planned(back, 1.0, room, seen, seen), params)
    assert reverse.tolist() == pytest.approx([min(wanted, params.reactive.reverse_speed)] * 2, abs=1e-5)


def test_the_speed_before_what_is_slow_is_what_can_be_braked_from():
    """v^2 = v'^2 + 2 a s from place to place, and standing where the direction changes."""
    params, blocked = GoalParams(braking=0.1), np.zeros((60, 60), bool)
    around = Surroundings(blocked, ~blocked, -1.0, -1.0, 0.05)
    x = [0.0, 0.2, 0.5, 0.6, 0.7]
    way = np.array([[v, 0.0, 0.0, 0.0, 1.0] for v in x], np.float32)
    seen = np.zeros((60, 60), np.float32)
    unseen = seen.copy()
    unseen[:, round((0.65 + 0.3 + 1) / 0.05) :] = 1  # what the bumper comes over at the last place
    speeds = allowed_speeds(way, around, Planned(way, 1.0, seen + 9, unseen, seen), params)
    wanted = [math.sqrt(params.creep**2 + 2 * 0.1 * (0.7 - v)) for v in x]
    assert speeds.tolist() == pytest.approx(wanted, abs=1e-5)
    assert wanted[0] < params.speed
    way[3:, 4] = -1.0
    speeds = allowed_speeds(way, around, Planned(way, 1.0, seen + 9, seen, seen), params)
    back = params.reactive.reverse_speed
    begun = [math.sqrt(0.2 * 0.5), math.sqrt(0.2 * 0.3), math.sqrt(back**2 + 0.2 * 0.1), back, back]
    assert speeds.tolist() == pytest.approx(begun, abs=1e-5)
