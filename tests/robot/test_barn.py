"""Worlds of the BARN challenge: read, scored, driven once and kept."""

import json
import math

import pandas as pd
import pytest

from ndtorch.errors import InputError
from ndtorch_robot.barn import BarnFile, attempt, read_worlds, totals
from ndtorch_robot.config import RobotOptions

FILE = {
    "source": "another project",  # files of others have keys that are not read
    "radius_m": 0.075,
    "height_m": 1.0,
    "goal_radius_m": 1.0,
    "time_limit_s": 100.0,
    "start": [0.0, 0.0, 90.0],
    "goal": [0.0, 10.0],
    "worlds": [
        {"world": 5, "path_m": 12.0, "cylinders": [[0.3, 4.0], [-0.9, 5.0]]},
        {"world": 6, "path_m": 10.0, "cylinders": [[2.0, 4.0]]},
    ],
}


def small(**changes):
    """A post beside the way, and a goal three metres ahead."""
    world = {"world": 7, "path_m": 3.0, "cylinders": ((0.6, 1.5), (-0.7, 2.5))}
    return BarnFile(**FILE | {"goal": (0.0, 3.0), "time_limit_s": 15.0, "worlds": (world | changes,)})


def test_a_file_is_read_and_worlds_are_split_by_their_numbers(tmp_path):
    path = tmp_path / "worlds.json"
    path.write_text(json.dumps(FILE))
    file = read_worlds(path)
    first, second = file.worlds
    assert (first.world, first.is_test, second.is_test) == (5, True, False)
    plan = file.plan(first)
    assert plan.start == (0.0, 0.0, pytest.approx(math.pi / 2))
    assert [solid.radius for solid in plan.solids] == [0.075, 0.075]
    for text, message in ((json.dumps({**FILE, "worlds": [{"world": 1}]}), "path_m is missing"), ("x", "a JSON file")):
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            read_worlds(path)
    with pytest.raises(InputError, match="no such file"):
        read_worlds(tmp_path / "none.json")


def test_the_score_is_that_of_the_challenge():
    (world,) = small(path_m=12.0).worlds  # optimal time 6 s
    assert world.score(None) == 0
    assert world.score(3.0) == world.score(12.0) == pytest.approx(0.5)
    assert world.score(24.0) == pytest.approx(0.25)
    assert world.score(99.0) == pytest.approx(1 / 8)


def test_totals():
    attempts = [(True, False, 20.0, 0.3), (False, True, 8.0, 0.0), (False, False, 100.0, 0.0)]
    row = totals(pd.DataFrame(attempts, columns=["success", "collided", "time_s", "score"])).iloc[0]
    assert (row.worlds, row.success, row.collided, row.score) == pytest.approx((3, 1 / 3, 1 / 3, 0.1))
    assert row.median_time_s == 20.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "outcome", "least", "most"),
    [
        ({}, (True, False), 3.0, 12.0),
        ({"time_limit_s": 1.0}, (False, False), 1.0, 1.1),
    ],
)
def test_a_drive_ends_at_its_goal_and_when_the_time_is_over(changes, outcome, least, most):
    result = attempt((BarnFile(**small().model_dump() | changes), RobotOptions("goal", stereo="search")))
    assert (result["success"], result["collided"]) == outcome
    assert least <= result["time_s"] <= most
