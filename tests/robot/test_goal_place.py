"""A drive to a place where the car cannot be is refused before it begins, in one sentence."""

import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import check_goal
from ndtorch_robot.sim.arenas import load_arena


def test_a_goal_outside_of_the_building_or_in_a_wall_is_refused() -> None:
    plan = load_arena("room", 100)
    left, right, bottom, top = plan.bounds
    places = np.random.default_rng(0).uniform((left, bottom), (right, top), (200, 2))
    free = places[plan.clearance(places).argmax()]
    check_goal(DriveConfig(arena="room", controller="goal", goal="{:.2f},{:.2f}".format(*free)), plan)
    check_goal(DriveConfig(arena="room", controller="goal"), plan)
    for x, y in ((right + 3, 0.0), (left - 40, bottom - 40), (right, top)):
        with pytest.raises(InputError, match="no free place of room"):
            check_goal(DriveConfig(arena="room", controller="goal", goal=f"{x},{y}"), plan)
