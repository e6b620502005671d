"""The bridge to ROS 2, seen by another process that decodes with message types of its own."""

import json
import math
import os
import select
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("cyclonedds")

from ndtorch.navigation import Command, Grid, GridMap, NavigatorState, Pose, Ranges, StereoRig
from ndtorch_robot.bridges import Opening, Wish, open_bridges
from ndtorch_robot.bridges.registry import command_of
from ndtorch_robot.bridges.ros2 import wire_type
from ndtorch_robot.ports import STAND, DriveCommand, Step
from tests.robot.support import ros2_peer
from tests.robot.support.autopilot import wait_for

DOMAIN = 20 + os.getpid() % 200
"""One for each process that tests."""


def plain_step():
    """A step of a car that ranges two places, and what a bridge asks of its runner; nothing is compiled."""
    x, y, grid = np.array([0.8, -0.5]), np.array([0.4, -0.6]), Grid(-1, 1, -1, 1)
    ranges, command = Ranges(x, x, x, x, y, np.array([True, True])), DriveCommand(0.4, 0.5)
    still, pose = Command(0.0, 0.0), Pose(1.0, 2.0, 0.3)
    state = NavigatorState(None, None, None, still, pose, None, 0.0, ranges, None, None, None)
    navigator = SimpleNamespace(grid_map=GridMap(StereoRig(), grid), controller=SimpleNamespace(has_goals=True))
    runner = SimpleNamespace(grid=grid, navigator=navigator, new_goal=None)
    runner.drive_to = lambda *goal: setattr(runner, "new_goal", goal)
    return Step(3, 12.5, None, command, command, command, state), runner


@pytest.fixture(scope="module")
def seen():
    """What a peer got of a known step, and the runner and the wish that it wrote to."""
    step, runner = plain_step()
    step = step._replace(telemetry={"battery_v": 7.4, "faults": ["none"]}, standing="told to stop")
    lines, wish = [], Wish(timeout=60)
    opening = Opening("x", lines.append, runner, wish=wish)
    with open_bridges({"ros2": {"domain_id": DOMAIN, "interface": "lo", "map_period_s": 0.1}}, opening) as (thread,):
        words = [sys.executable, ros2_peer.__file__, str(DOMAIN)]
        peer = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert peer.stdin is not None
        assert peer.stdout is not None
        number, began = 0, time.time()
        while time.time() < began + 60 and not select.select([peer.stdout], [], [], 0.02)[0]:
            number += 1
            thread(step._replace(time=step.time + 0.05 * number))
        out = peer.stdout.readline() if time.time() < began + 60 else ""
        assert wait_for(lambda: runner.new_goal is not None and wish.newest[0] != STAND)
        peer.communicate(timeout=20)
    assert lines == []
    return json.loads(out), step, runner, wish, began


def test_scan_and_odometry(seen):
    got, *_ = seen
    scan, odom = got["scan"], got["odom"]
    assert (scan["header"]["frame_id"], odom["header"]["frame_id"], odom["child_frame_id"]) == (
        "base_link",
        "odom",
        "base_link",
    )
    bearings = {scan["angle_min"] + n * scan["angle_increment"]: r for n, r in enumerate(scan["ranges"]) if r}
    ((bearing, distance),) = bearings.items()  # the other place lies behind
    assert bearing == pytest.approx(math.atan2(0.4, 0.8), abs=0.01)
    assert distance == pytest.approx(math.hypot(0.4, 0.8))
    pose, twist = odom["pose"]["pose"], odom["twist"]["twist"]
    assert (pose["position"]["x"], pose["position"]["y"]) == pytest.approx((1.0, 2.0))
    assert 2 * math.atan2(pose["orientation"]["z"], pose["orientation"]["w"]) == pytest.approx(0.3)
    assert (twist["linear"]["x"], twist["angular"]["z"]) == pytest.approx((0.4, 0.2))


def test_stamps_are_of_the_wall_clock(seen):
    got, *_, began = seen
    stamp = got["odom"]["header"]["stamp"]
    assert began - 1 < stamp["sec"] + stamp["nanosec"] * 1e-9 < time.time() + 60


def test_the_command_is_what_the_safety_layer_sent(seen):
    got, step, *_ = seen
    assert got["cmd_vel"]["linear"]["x"] == pytest.approx(step.sent.speed)
    assert got["cmd_vel"]["angular"]["z"] == pytest.approx(step.sent.speed * step.sent.curvature)


def test_map_and_diagnostics(seen):
    got, *_ = seen
    info = got["map"]["info"]
    assert (info["width"] * info["resolution"], info["height"]) == pytest.approx((2.0, info["width"]))
    assert len(got["map"]["data"]) == info["width"] * info["height"]
    assert info["origin"]["position"] == {"x": -1.0, "y": -1.0, "z": 0.0}
    (status,) = got["diagnostics"]["status"]
    assert (status["level"], status["message"]) == (2, "told to stop")
    assert {"key": "battery_v", "value": "7.4"} in status["values"]


def test_commands_and_goals_come_in(seen):
    _, _, runner, wish, _ = seen
    assert wish() == pytest.approx((0.3, -2.0))
    assert runner.new_goal == (3.0, -1.5)


def test_a_turn_on_the_spot_is_a_stand():
    assert command_of(0.0, 1.0) == STAND
    assert command_of(-0.4, 0.2) == pytest.approx((-0.4, -0.5))


@pytest.mark.parametrize("kind", ["LaserScan", "Odometry", "OccupancyGrid", "Twist", "DiagnosticArray", "PoseStamped"])
def test_types_are_announced_as_ros_2_does(kind):
    """Name and fields, by the types that were written down by hand."""
    ours = {"LaserScan": "sensor", "Odometry": "nav", "OccupancyGrid": "nav", "DiagnosticArray": "diagnostic"}
    made = wire_type(f"{ours.get(kind, 'geometry')}_msgs/msg/{kind}")
    hand = getattr(ros2_peer, f"{kind}_")
    for each in (made, hand):
        each.__idl__.populate()
        each.__idl__.fill_type_data()
    assert made.__idl__.get_type_id() == hand.__idl__.get_type_id()
