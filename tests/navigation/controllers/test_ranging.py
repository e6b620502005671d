"""The ranging controller: its decisions on cells made up by a formula."""

import copy

import numpy as np

from ndtorch.navigation import CRUISE, REVERSE, SUPPRESSED, TURN, Command, Pose, Ranges, StereoRig
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.floor import BLOCKS, floor_view
from ndtorch.navigation.odometry import arc

DT = 1 / 30
RIG = StereoRig(forward=0.15)
VIEW = floor_view(RIG)


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
