"""The goal controller: what it is asked to do, and that its state is all it has."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import (
    ARRIVED,
    CRUISE,
    STOPPED,
    SUPPRESSED,
    Command,
    Navigator,
    NavigatorOptions,
    Pose,
    StereoRig,
)
from ndtorch.navigation.controllers.contract import Task
from ndtorch.navigation.controllers.goal import GoalControl, GoalParams
from ndtorch.navigation.controllers.goal.params import reactive_params
from ndtorch.navigation.controllers.goal.state import MAX_POINTS
from ndtorch.navigation.controllers.goal.tasks import EXPLORE, GOAL
from ndtorch.navigation.local_grid.grid import LocalGridParams, cells_at
from ndtorch.navigation.localisation import Localiser
from ndtorch.navigation.odometry import arc
from ndtorch.navigation.planning._kernels import lattice_astar
from ndtorch.navigation.proximity.stereo_match import Obstacles
from ndtorch.navigation.stereo.ranging import Ranges

RIG, DT = StereoRig(forward=0.15), 1 / 30
SMALL = replace(reactive_params(), grid=LocalGridParams(cell=0.05, size=128))


def nothing():
    blank = np.zeros(4, np.float32)
    return Ranges(blank, blank, blank, blank, blank, blank > 0)


def floor(moves=True):
    """What open floor gives while the car moves at a steady speed, roughly; nothing while it stands."""
    return np.full((2, 14, 8), 0.5 if moves else 0.0, np.float32)


def drive(control, steps, pose, state=None):
    """Through open floor: the commands are obeyed at once."""
    command = Command(0.0, 0.0)
    state = control.start(floor(), pose) if state is None else state
    for _ in range(steps):
        command, state = control.step(floor(moves=command.speed != 0), nothing(), pose, command, state)
        pose = arc(pose, *command, DT)
    return pose, state, command


def place(x, y, heading):
    return Pose(x, y, heading)


def test_it_goes_to_the_place_and_back_and_stands():
    control = GoalControl(RIG, DT, GoalParams(goal=(1.5, 0.5), return_home=True, reactive=SMALL))
    state, pose, nearest = None, place(0.0, 0.0, 0.0), 9.0
    for _ in range(60):
        pose, state, command = drive(control, 10, pose, state)
        nearest = min(nearest, math.hypot(pose.x - 1.5, pose.y - 0.5))
        if int(control.mode(state)) == ARRIVED:
            break
    assert nearest < 0.5
    assert math.hypot(pose.x, pose.y) < 0.35
    assert float(command.speed) == 0


def test_it_goes_to_a_place_farther_away_than_it_remembers():
    """The memory is a square around the car that comes along: 1.6 m to each side here."""
    near = replace(SMALL, grid=LocalGridParams(cell=0.05, size=64))
    control = GoalControl(RIG, DT, GoalParams(goal=(4.5, 0.0), reactive=near))
    state, pose = None, place(0.0, 0.0, 0.0)
    for _ in range(90):
        pose, state, _ = drive(control, 10, pose, state)
        if int(control.mode(state)) == ARRIVED:
            break
    assert int(control.mode(state)) == ARRIVED
    assert math.hypot(pose.x - 4.5, pose.y) < 0.35


def test_the_same_state_gives_the_same_step_and_stays_as_it_was():
    control = GoalControl(RIG, DT, GoalParams(goal=(3.0, 0.0), reactive=SMALL))
    pose, state, command = drive(control, 30, place(0.0, 0.0, 0.0))
    kept = copy.deepcopy(state)
    one, two = (control.step(floor(), nothing(), pose, command, state) for _ in range(2))
    assert one[0] == two[0]
    assert np.array_equal(one[1].path, two[1].path)
    assert np.array_equal(kept.reactive.grid.evidence, state.reactive.grid.evidence)
    assert np.array_equal(kept.path, state.path)
    assert [part for part in kept[2:] if not isinstance(part, np.ndarray)] == [
        part for part in state[2:] if not isinstance(part, np.ndarray)
    ]


def test_what_is_ranged_in_the_way_is_driven_around():
    control = GoalControl(RIG, DT, GoalParams(goal=(3.0, 0.0), reactive=SMALL))
    pose, state, command = drive(control, 20, place(0.0, 0.0, 0.0))
    assert int(control.mode(state)) == CRUISE
    straight = state.path[: state.points]
    assert np.abs(straight[:, 1]).max() < 0.05
    x = 1.6 - pose.x
    across = (np.array([-0.1, -0.03, 0.03, 0.1]) - pose.y).astype(np.float32)
    wall = Ranges(across * 0, across * 0, across * 0, np.full(4, x, np.float32), across, np.ones(4, bool))
    for _ in range(10):
        command, state = control.step(floor(), wall, pose, command, state)
    way = state.path[: int(state.points)]
    beside = way[np.abs(way[:, 0] - 1.6) < 0.2]
    assert len(beside)
    assert np.abs(beside[:, 1]).min() > 0.3


def test_it_is_ready_before_a_car_depends_on_it():
    control = GoalControl(RIG, DT, GoalParams(goal=(3.0, 0.0), reactive=SMALL))
    control.warm_up()
    assert lattice_astar.run is lattice_astar.dispatcher


def test_what_cannot_be_asked_for_is_said():
    with pytest.raises(InputError, match="controller goal"):
        NavigatorOptions(goal="1,2").navigator(RIG, 30.0)
    for to in ("1", "a,b", "1,2,3", "nan,1"):
        with pytest.raises(InputError, match="X,Y"):
            NavigatorOptions("goal", goal=to)
    with pytest.raises(InputError, match="speed must be"):
        NavigatorOptions(speed=2.0)


@pytest.mark.parametrize("name", ["ranging", "published", "goal"])
def test_no_controller_is_told_to_go_faster_than_its_cruise_speed(name):
    params = NavigatorOptions(name, speed=0.25).make(RIG, DT).params
    assert getattr(params, "speed_m_per_s" if name == "goal" else "speed") == 0.25
    reactive = getattr(params, "reactive", params)
    for key in ("tight_speed", "reverse_speed", "tight_speed_m_per_s", "unknown_speed_m_per_s"):
        assert getattr(params, key, 0) <= 0.25
        assert getattr(reactive, key, 0) <= 0.25


class Shifted(Localiser):
    """The car is a metre farther ahead than dead reckoning says, and ever more."""

    def __call__(self, rows, in_odometry, state=None):
        pose = np.array([float(part) for part in in_odometry])
        state = self.start(pose) if state is None else state
        return state._replace(pose=pose + np.array((1 + 0.1 * state.age, 0, 0)), age=state.age + 1)


def test_the_navigator_tells_it_where_it_is_at_every_frame():
    params = GoalParams(goal=(3.0, 0.0), reactive=SMALL)
    navigator = Navigator(RIG, DT, controller="goal", params=params, localiser=Shifted(RIG, DT))
    eyes = torch.zeros(3, 1, 480, 640, dtype=torch.uint8)
    command, state = navigator(eyes, eyes)
    assert state.control.frame == pytest.approx([-1.2, 0.0, 0.0])
    assert float(state.place.x) == pytest.approx(float(state.pose.x) + 1.2)
    one = None
    for t in range(3):
        single, one = navigator(eyes[t : t + 1], eyes[t : t + 1], one)
        assert float(single.speed) == float(command.speed[t])
    assert one.control.frame == state.control.frame


def test_it_does_not_begin_with_something_near_and_says_so():
    control = GoalControl(RIG, DT, GoalParams(goal=(3.0, 0.0), reactive=SMALL))
    here, still = place(0.0, 0.0, 0.0), Command(0.0, 0.0)
    across = Obstacles(np.full(9, 0.4, np.float32), np.linspace(-0.3, 0.3, 9, dtype=np.float32))
    nobody = Obstacles(np.zeros(0, np.float32), np.zeros(0, np.float32))
    state, command = control.start(floor(), here), still
    for _ in range(8):
        state = control.on_near_obstacles(state, here, nobody, across, False)
        command, state = control.step(floor(moves=False), nothing(), here, still, state)
    assert float(command.speed) == 0
    assert int(control.mode(state)) == STOPPED
    assert "it cannot begin" in control.status_message(state)
    for _ in range(8):
        state = control.on_near_obstacles(state, here, nobody, across, True)
        command, state = control.step(floor(moves=False), nothing(), here, still, state)
    assert float(command.speed) > 0


def test_a_line_of_sight_was_free_from_the_camera_to_just_before_what_is_seen():
    """Each of its cells loses `miss`, places of a line that share one together; the range itself counts."""
    control, p = GoalControl(RIG, DT, GoalParams(goal=(3.0, 0.0), reactive=SMALL)), SMALL.grid
    here = place(0.0, 0.0, 0.0)
    x, y = np.array([RIG.forward + 2.0], np.float32), np.array([0.5], np.float32)
    seen = Ranges(x * 0, x * 0, x * 0, x, y, np.array([True]))
    _, state = control.step(floor(moves=False), seen, here, Command(0.0, 0.0), control.start(None, here))
    evidence = state.reactive.grid.evidence.ravel()
    share = np.linspace(0.15, 0.88, 24)
    line = cells_at(tuple(here), RIG.forward + 2.0 * share, 0.5 * share, p)
    # Those below the car lose more.
    assert evidence[np.unique(line[8:])] == pytest.approx(-control.params.miss_evidence, abs=1e-6)
    assert evidence[cells_at(tuple(here), x, y, p)] == pytest.approx(SMALL.range_weight)


def test_it_begins_knowing_nothing_and_about_its_first_errand():
    pose = place(1.0, 2.0, 0.5)
    for params, errand, cells in ((GoalParams(goal=(3.0, 0.0)), GOAL, 0), (GoalParams(), EXPLORE, 512)):
        state = GoalControl(RIG, DT, params).start(floor(), pose)
        values = state._asdict()
        assert values.pop("home") == (1.0, 2.0)
        assert values.pop("frame") == (0.0, 0.0, 0.0)
        assert values.pop("path").tolist() == [[0.0] * 6] * MAX_POINTS
        assert values.pop("reactive").mode == SUPPRESSED
        visited = values.pop("visited").evidence
        assert visited.shape == (cells, cells)
        assert not visited.any()
        given = {"task": errand, "direction": 1, "best_cost": math.inf, "mode": SUPPRESSED}
        assert values == dict.fromkeys(values, 0) | given


def test_the_places_around_the_car_count_as_visited_and_those_before_stay():
    control = GoalControl(RIG, DT, GoalParams(explore=True, reactive=SMALL))
    p, pose = control.params, place(0.0, 0.0, 0.0)
    once = control.visit(control.start(floor(), pose).visited, pose)
    assert float(once.evidence.sum()) == control.disc.shape[1]
    area = float(once.evidence.sum()) * p.visited_grid.cell**2
    assert area == pytest.approx(math.pi * p.visited_radius_m**2, rel=0.05)
    assert np.array_equal(control.visit(once, pose).evidence, once.evidence)
    both = control.visit(once, place(3.0, 0.0, 0.0))
    assert float(both.evidence.sum()) == 2 * control.disc.shape[1]


def test_a_task_sets_the_speeds_and_leaves_the_rest():
    usual = GoalParams()
    asked = GoalControl.params_for(Task(goal=(1.0, 2.0), explore=True, return_home=True, speed=0.5))
    assert asked == replace(usual, goal=(1.0, 2.0), explore=True, return_home=True, reactive=asked.reactive)
    assert asked.reactive == usual.reactive
    slow = GoalControl.params_for(Task(speed=0.2))
    assert (slow.goal, slow.explore, slow.return_home) == (None, False, False)
    assert (slow.speed_m_per_s, slow.tight_speed_m_per_s, slow.unknown_speed_m_per_s) == (0.2, 0.2, 0.2)
    r = slow.reactive
    assert (r.speed, r.tight_speed, r.reverse_speed) == pytest.approx((0.2, 0.16, 0.2))
    assert replace(r, speed=0.5, tight_speed=usual.reactive.tight_speed, reverse_speed=0.3) == usual.reactive
    assert not r.overhangs
