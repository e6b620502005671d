"""The ranging controller: its decisions on cells made up by a formula."""

import copy

import numpy as np
import pytest
import torch

from ndtorch.navigation import (
    CRUISE,
    REVERSE,
    STOPPED,
    SUPPRESSED,
    TURN,
    AvoidanceParams,
    Command,
    Pose,
    Ranges,
    StereoRig,
)
from ndtorch.navigation.controllers.published import SaccadeAvoidance
from ndtorch.navigation.controllers.ranging._kernels import next_mode
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.floor import floor_view
from ndtorch.navigation.controllers.ranging.params import FloorParams
from ndtorch.navigation.odometry import arc

DT = 1 / 30
RIG = StereoRig(forward=0.15)
VIEW = floor_view(RIG, FloorParams())
BANDS, BLOCKS = FloorParams().bands, FloorParams().blocks


def cells_of(depth, speed, curvature=0.0):
    """Outputs when the floor ends at `depth` `[2, BLOCKS]` metres ahead, a blank wall behind; one camera sees each."""
    flow = np.hypot(430 * 0.2 / VIEW.depth**2 * abs(speed) * DT, 430 * speed * curvature * DT)
    floor = (0.18 * (1 - np.exp(-flow / 1.2)))[:, None]
    cells = np.where(VIEW.depth[:, None] < np.asarray(depth)[:, None, :], floor, 0.0)
    return np.concatenate((cells, np.full_like(cells, -1))).astype(np.float32)


def ranges_of(places, valid=True):
    """Ranges of which only the places in the body frame `[2, n]` matter."""
    x, y = np.asarray(places, np.float32)
    blank = np.zeros_like(x)
    return Ranges(blank, blank, blank, x, y, np.full(x.shape, valid))


NOWHERE = ranges_of(np.zeros((2, 1)), False)


def run(look, steps, control=None, start=(0.0, 0.0, 0.0), ranges=None):
    """Close the loop with a car that does at once what it is told; returns poses, commands and modes.

    Args:
        look: `look(pose, step)` -> depth at which the floor ends, `[2, BLOCKS]`.
        ranges: `ranges(pose)` -> places in the body frame that are ranged, `[2, n]`.
    """
    control = control or RangingControl(RIG, DT)
    pose, command = Pose(*start), Command(0.0, 0.0)
    state = control.start(None, pose)
    poses, commands, modes = [], [], []
    for n in range(steps):
        cells = cells_of(look(pose, n), *command)
        there = NOWHERE if ranges is None else ranges_of(ranges(pose))
        command, state = control.step(cells, there, pose, command, state)
        poses.append(pose)
        commands.append(command)
        modes.append(control.mode(state))
        pose = arc(pose, *command, DT)
    return np.array(poses), np.array(commands), modes


def open_floor(pose, n):
    return np.full((2, BLOCKS), 9.0)


def wall_ahead(x):
    """A wall across the path at x, seen from any pose that faces it."""

    def look(pose, n):
        eye = pose.x + 0.15 * np.cos(pose.heading)
        slope = (VIEW.y[:, 0] - np.array([[0.15], [-0.15]])) / float(VIEW.depth[0])
        across = np.cos(pose.heading) - slope * np.sin(pose.heading)
        return np.where(across > 0.05, (x - eye) / across.clip(min=0.05), 9.0)

    return look


def test_drives_straight_over_open_floor():
    _, commands, modes = run(open_floor, 90)
    assert modes[:14] == [SUPPRESSED] * 14
    assert modes[15:] == [CRUISE] * 75
    assert (commands[:3, 0] == 0).all()  # it stands to measure the noise
    assert (commands[4:, 0] == 0.5).all()
    assert (commands[:, 1] == 0).all()


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("seen_from_m", [0.03, 0.06, 0.1])
def test_a_post_that_is_seen_only_while_the_floor_is_learned_is_not_touched(side, seen_from_m):
    """A post at a front corner leaves the view before the car has learned its floor."""
    post = np.array([[0.65], [side * 0.17]])

    def ranged(pose):
        return seen_from(pose, post if 0 <= pose.x - seen_from_m < 0.05 else np.array([[9.0], [9.0]]))

    poses, _, modes = run(open_floor, 300, ranges=ranged)
    x, y = np.stack([seen_from(Pose(*pose), post)[:, 0] for pose in poses]).T
    assert not ((np.abs(x) < 0.25) & (np.abs(y) < 0.18)).any()
    assert next(mode for mode in modes if mode != SUPPRESSED) != STOPPED  # to begin again would bring it nearer


def half_hidden(side):
    """After a second the floor of one side ends 0.8 m ahead."""

    def look(pose, n):
        depth = np.full((2, BLOCKS), 9.0)
        depth[side] = 0.8 if n > 30 else 9.0
        return depth

    return look


def test_turns_before_a_wall_and_goes_on():
    poses, _, modes = run(wall_ahead(4.0), 330)
    assert float(poses[:, 0].max()) < 4.0 - 0.3  # half the body's length and a little
    turned = modes.index(TURN)
    assert 0.8 < 4.0 - float(poses[turned, 0]) < 1.6
    assert CRUISE in modes[turned:]
    assert REVERSE not in modes
    assert abs(float(poses[-1, 2])) > 1.0


def test_reversing_retraces():
    """At the end of a corridor too narrow to turn in the car goes straight back the way it came."""
    poses, commands, modes = run(open_floor, 200, ranges=lambda pose: narrow_end(pose, 2.0))
    first = modes.index(REVERSE)
    last = next(k for k in range(first, len(modes)) if modes[k] != REVERSE)
    assert float(poses[:, 0].max()) < 2.0 - 0.3
    assert (commands[first:last, 0] < 0).all()
    assert 0.1 < float(poses[first, 0] - poses[last, 0]) < 0.6
    assert abs(poses[last, 1] - poses[first, 1]) < 0.1


def test_no_farther_back_than_it_has_been():
    """In a dead end in which the car starts it goes to and fro on its own path."""
    poses, _, modes = run(open_floor, 600, ranges=lambda pose: narrow_end(pose, 2.0))
    assert modes.count(REVERSE) > 60
    corners = poses[:, 0] - 0.25 * np.cos(poses[:, 2]) - 0.18 * np.abs(np.sin(poses[:, 2]))
    assert corners.min() > -0.25 - 0.08  # a cell behind where its rear was at first


def test_before_a_wall_nearer_than_the_floor_in_view_only_what_was_seen_free_is_free():
    """From the third second on no floor is in view: the car goes back to where it began, and turns to no side."""
    poses, _, _ = run(lambda pose, n: np.full((2, BLOCKS), 0.3 if n > 60 else 9.0), 300)
    assert poses[:, 0].min() > -0.05
    assert np.abs(poses[200:, 2]).max() < 0.15


def seen_from(pose, world):
    """Places `[2, n]` of the world in the body frame."""
    dx, dy = world[0] - pose.x, world[1] - pose.y
    cos, sin = np.cos(pose.heading), np.sin(pose.heading)
    return np.stack((cos * dx + sin * dy, cos * dy - sin * dx))


def narrow_end(pose, wall):
    """Ranged places of a wall across the path and of both sides of the corridor that ends there."""
    y, x = np.linspace(-0.36, 0.36, 10), np.linspace(wall - 1.2, wall, 16)
    sides = [np.stack((x, np.full_like(x, side))) for side in (0.42, -0.42)]
    return seen_from(pose, np.concatenate([np.stack((np.full_like(y, wall), y)), *sides], -1))


def test_ranges_alone_turn_the_car():
    """A wall ahead and on the left side that only the rows see."""

    def posts(pose):
        y, x = np.linspace(0.0, 0.7, 8), np.linspace(1.0, 2.0, 8)
        return seen_from(
            pose, np.concatenate((np.stack((np.full_like(y, 2.0), y)), np.stack((x, np.full_like(x, 0.7)))), -1)
        )

    poses, commands, modes = run(open_floor, 120, ranges=posts)
    assert TURN in modes
    turned = modes.index(TURN)
    assert float(commands[turned, 1]) < 0
    # Nothing was seen free on that side: it backs once before, where it has been, and no farther.
    assert modes[turned - 1] == REVERSE
    assert modes[modes.index(REVERSE) - 1] == CRUISE
    assert float(poses[:, 0].min()) > -0.05


def test_a_state_is_never_written():
    control = RangingControl(RIG, DT)
    pose, command = Pose(0.0, 0.0, 0.0), Command(0.5, 0.1)
    state = control.start(None, pose)
    cells = cells_of(open_floor(pose, 0), *command)
    for _ in range(20):
        _, state = control.step(cells, NOWHERE, pose, command, state)
    kept = copy.deepcopy(state)
    first, one = control.step(cells, NOWHERE, pose, command, state)
    second, other = control.step(cells, NOWHERE, pose, command, state)
    assert first == second
    for before, now in ((kept, state), (one, other)):
        for ours, theirs in zip(before[:3], now[:3], strict=True):
            assert all(np.array_equal(a, b) for a, b in zip(ours, theirs, strict=True))
        assert before[3:] == now[3:]


@pytest.mark.parametrize(("side", "away"), [(0, -1), (1, 1)])
def test_turns_away_from_hidden_floor(side, away):
    _, commands, modes = run(half_hidden(side), 60)
    turns = commands[:, 1][commands[:, 1] != 0]
    assert TURN in modes[33:43]  # four frames for each cell, and it has to be near
    assert len(turns) > 10
    assert (np.sign(turns) == away).all()


@pytest.mark.parametrize(("side", "away"), [(0, -1), (1, 1)])
def test_the_published_rule_turns_towards_it(side, away):
    """The same floor as largest outputs: less motion on the hidden side, and that is where it turns to."""
    sides = torch.full((120, 2), 0.5)
    sides[30:, side] = 0.05
    command, _ = SaccadeAvoidance(DT, AvoidanceParams())(sides)
    turns = command.curvature[command.curvature != 0]
    assert turns.numel() > 10
    assert (turns.sign() == -away).all()


FACTS = "learning", "blocked_ahead", "clear", "blocked_sides", "reverse_done", "blocked_rear"


@pytest.mark.parametrize(
    ("mode", "true", "then"),
    [
        (SUPPRESSED, ["learning"], SUPPRESSED),
        (SUPPRESSED, ["learning", "blocked_ahead", "blocked_sides"], SUPPRESSED),
        (SUPPRESSED, [], CRUISE),
        (SUPPRESSED, ["blocked_ahead"], TURN),
        (CRUISE, [], CRUISE),
        (CRUISE, ["blocked_sides", "blocked_rear"], CRUISE),
        (CRUISE, ["blocked_ahead"], TURN),
        (CRUISE, ["blocked_ahead", "blocked_sides"], REVERSE),
        (CRUISE, ["blocked_ahead", "blocked_sides", "blocked_rear"], STOPPED),
        (TURN, ["blocked_ahead"], TURN),
        (TURN, [], TURN),
        (TURN, ["clear"], CRUISE),
        (TURN, ["blocked_ahead", "blocked_sides"], REVERSE),
        (TURN, ["blocked_ahead", "blocked_sides", "blocked_rear"], STOPPED),
        (REVERSE, ["blocked_ahead", "blocked_sides"], REVERSE),
        (REVERSE, ["blocked_ahead", "blocked_sides", "blocked_rear"], REVERSE),
        (REVERSE, ["blocked_ahead", "blocked_sides", "reverse_done"], TURN),
        (STOPPED, ["blocked_ahead", "blocked_sides", "blocked_rear"], STOPPED),
        (STOPPED, ["blocked_ahead", "blocked_sides"], REVERSE),
        (STOPPED, ["blocked_ahead"], TURN),
    ],
)
def test_transitions(mode, true, then):
    assert next_mode(mode, *(fact in true for fact in FACTS)) == then


@pytest.mark.parametrize("moves", [0.06, 0.3])
def test_noise_of_a_passer_by_is_forgotten_before_the_car_goes_on(moves):
    control, pose, command = RangingControl(RIG, DT), Pose(0.0, 0.0, 0.0), Command(0.0, 0.0)
    state, speeds, modes = control.start(None, pose), [], []
    for n in range(180):
        passes = 60 <= n < 75
        driven = Command(0.0, 0.0) if passes else command
        cells = np.full((4, BANDS, BLOCKS), moves, np.float32) if passes else cells_of(open_floor(pose, n), *driven)
        command, state = control.step(cells, NOWHERE, pose, driven, state)
        speeds.append(command.speed)
        modes.append(control.mode(state))
    assert speeds[59] == 0.5
    assert modes[74] == STOPPED
    assert max(speeds[70:75]) == 0.0
    begins = next(n for n in range(75, 180) if speeds[n] > 0)
    assert begins < 120  # noise falls by a third with every step
    assert speeds[begins + 20] == 0.5
    assert control.status_message(state) is None
