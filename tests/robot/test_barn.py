"""Worlds of the BARN challenge: read, scored, driven once and kept."""

import json
import math
import threading
from types import SimpleNamespace

import pytest

from ndtorch.errors import InputError
from ndtorch_robot.barn import Attempt, BarnFile, Referee, attempt, read_worlds, table, totals
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


def made(number, success=True, collided=False, time=20.0, score=0.3):
    return Attempt(number, success, collided, time, score, 2.0)


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
    for text, message in ((json.dumps({**FILE, "worlds": [{"world": 1}]}), "path_m is missing"), ("x", "no JSON")):
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            read_worlds(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_worlds(tmp_path / "none.json")


def test_the_score_is_that_of_the_challenge():
    (world,) = small(path_m=12.0).worlds  # optimal time 6 s
    assert world.score(None) == 0
    assert world.score(3.0) == world.score(12.0) == pytest.approx(0.5)
    assert world.score(24.0) == pytest.approx(0.25)
    assert world.score(99.0) == pytest.approx(1 / 8)


def test_tables():
    some = [made(1), made(2, False, True, 8.0, 0.0), made(3, False, False, 100.0, 0.0)]
    sums = totals(some)
    assert (sums["success"], sums["collided"], sums["score"]) == pytest.approx((1 / 3, 1 / 3, 0.1))
    assert table(some, "note").splitlines()[2] == "| 3 | 0.33 | 0.33 | 0.100 | 20.0 s |"


@pytest.mark.slow
def test_a_world_is_driven_to_its_goal():
    reached = attempt(small(), *small().worlds, RobotOptions("goal", stereo="search"))
    assert (reached.success, reached.collided) == (True, False)
    assert 3.0 < reached.time_s < 12.0


@pytest.mark.parametrize(
    ("pose", "hits", "now", "verdict"),
    [
        ((0.0, 1.0, 0.0), [], 5.0, (False, False, False)),
        ((0.3, 2.5, 0.0), [], 5.0, (True, False, True)),
        ((0.3, 2.5, 0.0), ["hit"], 5.0, (False, True, True)),
        ((0.0, 1.0, 0.0), [], 15.0, (False, False, True)),
    ],
)
def test_the_referee_ends_it_at_the_goal_at_a_collision_and_in_the_end(pose, hits, now, verdict):
    simulation = SimpleNamespace(pose=pose, collisions=hits, now=lambda: now)
    car = SimpleNamespace(ended=threading.Event())
    referee = Referee(small(), simulation, car)
    referee(SimpleNamespace(standing=None, number=0))
    assert (referee.success, referee.collided, car.ended.is_set()) == verdict
