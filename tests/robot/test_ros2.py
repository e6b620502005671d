"""Observers in threads of their own, and ROS 2 as another process sees it."""

import json
import math
import os
import select
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from ndtorch.navigation import Command, NavigatorState, Pose, Ranges
from ndtorch_robot.navigator_runner import seen_obstacles
from ndtorch_robot.ports import DriveCommand, Step
from ndtorch_robot.run_config import Ros2Table
from ndtorch_robot.step_thread import StepThread
from tests.robot.support.autopilot import wait_for
from tests.robot.support.cars import known_step


class Held(StepThread):
    """Takes a step, and the next one when it is let go."""

    poll_s = 0.01

    def __init__(self, lines):
        self.steps, self.go, self.closed, self.polls = [], threading.Event(), 0, 0
        super().__init__("held", 1, "newest", lines.append)

    def handle(self, item):
        self.steps.append(item)
        self.go.wait(20)

    def idle(self):
        self.polls += 1

    def finish(self):
        self.closed += 1

    def __call__(self, step):
        self.put(step)


def test_a_slow_observer_gets_the_newest_step():
    lines = []
    held = Held(lines)
    held(0)
    assert wait_for(lambda: held.steps == [0])
    for number in range(1, 50):
        held(number)
    held.go.set()
    assert wait_for(lambda: held.steps == [0, 49])
    assert wait_for(lambda: held.polls > 2)
    held.close()
    assert (held.closed, lines) == (1, [])


@pytest.mark.parametrize("pose", [(1.0, 2.0, 0.3), (-7.3, 40.2, 2.5)])
def test_remembered_obstacles_are_where_they_were_seen(pose):
    """Within half the diagonal of a cell of 8 cm, in the body frame, wherever the car is."""
    places = ((0.8, 0.4), (-0.5, -0.6), (1.5, -1.0))
    step, runner = known_step(pose, places)
    seen = seen_obstacles(step.state, runner.navigator)
    found = np.stack((seen.x, seen.y), 1)
    assert len(found) == len(places)
    for place in places:
        assert np.hypot(*(found - place).T).min() <= 0.04 * math.sqrt(2) + 1e-6


@pytest.fixture(scope="module")
def ros2():
    """What a process with message types of its own got of a known step, the runner, and when it began."""
    pytest.importorskip("cyclonedds")
    from ndtorch_robot.ros2 import Ros2Bridge
    from tests.robot.support import ros2_peer

    x, y = np.array([0.8, -0.5]), np.array([0.4, -0.6])
    ranges, command = Ranges(x, x, x, x, y, np.array([True, True])), DriveCommand(0.4, 0.5)
    fields = dict.fromkeys(NavigatorState._fields)
    state = NavigatorState(**fields | {"command": Command(0.0, 0.0), "pose": Pose(1.0, 2.0, 0.3), "ranges": ranges})
    navigator = SimpleNamespace(controller=SimpleNamespace(has_goals=True))
    runner = SimpleNamespace(navigator=navigator, new_goal=None)
    runner.drive_to = lambda *goal: setattr(runner, "new_goal", goal)
    step = Step(3, 12.5, None, command, command, command, state)
    lines, domain = [], 20 + os.getpid() % 200
    with Ros2Bridge(Ros2Table(domain_id=domain), runner, lines.append) as bridge:
        words = [sys.executable, ros2_peer.__file__, str(domain)]
        peer = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        number, began = 0, time.time()
        while time.time() < began + 60 and not select.select([peer.stdout], [], [], 0.02)[0]:
            number += 1
            bridge(step._replace(time=step.time + 0.05 * number))
        out = peer.stdout.readline() if time.time() < began + 60 else ""
        assert wait_for(lambda: runner.new_goal is not None)
        peer.communicate(timeout=20)
    assert lines == []
    return json.loads(out), runner, began


def test_topics_reach_another_process(ros2):
    got, runner, began = ros2
    scan, odom = got["scan"], got["odom"]
    assert (scan["header"]["frame_id"], odom["child_frame_id"]) == ("base_link", "base_link")
    bearings = {scan["angle_min"] + n * scan["angle_increment"]: r for n, r in enumerate(scan["ranges"]) if r}
    ((bearing, distance),) = bearings.items()  # the other place lies behind
    assert bearing == pytest.approx(math.atan2(0.4, 0.8), abs=0.01)
    assert distance == pytest.approx(math.hypot(0.4, 0.8))
    pose, twist, stamp = odom["pose"]["pose"], odom["twist"]["twist"], odom["header"]["stamp"]
    assert (pose["position"]["x"], pose["position"]["y"]) == pytest.approx((1.0, 2.0))
    assert 2 * math.atan2(pose["orientation"]["z"], pose["orientation"]["w"]) == pytest.approx(0.3)
    assert (twist["linear"]["x"], twist["angular"]["z"]) == pytest.approx((0.4, 0.2))
    assert began - 1 < stamp["sec"] + stamp["nanosec"] * 1e-9 < time.time() + 60
    assert runner.new_goal == (3.0, -1.5)


@pytest.mark.parametrize("kind", ["LaserScan", "Odometry", "PoseStamped"])
def test_types_are_announced_as_ros_2_does(kind):
    """Name and fields, by the types that were written down by hand."""
    pytest.importorskip("cyclonedds")
    from ndtorch_robot.ros2 import wire_type
    from tests.robot.support import ros2_peer

    packages = {"LaserScan": "sensor", "Odometry": "nav"}
    types = wire_type(f"{packages.get(kind, 'geometry')}_msgs/msg/{kind}"), getattr(ros2_peer, f"{kind}_")
    for each in types:
        each.__idl__.populate()
        each.__idl__.fill_type_data()
    assert types[0].__idl__.get_type_id() == types[1].__idl__.get_type_id()
