"""Bridges beside the loop: MAVLink as an autopilot hears it, ROS 2 as another process sees it."""

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

from ndtorch.errors import InputError
from ndtorch.navigation import Command, NavigatorState, Pose, Ranges
from ndtorch.utils.toml import Strict, check
from ndtorch_robot.bridges import BRIDGES, Bridge, Opening, bridge, open_bridges
from ndtorch_robot.navigator_runner import nearest_by_sector, seen_obstacles
from ndtorch_robot.ports import DriveCommand, Step
from ndtorch_robot.run_config import RunConfig
from tests.robot.support.autopilot import Autopilot, free_port, wait_for
from tests.robot.support.cars import RIG, FilmCar, bare_loop, known_step, moving_world


class Held(Bridge):
    """Takes a step, and the next one when it is let go."""

    def __init__(self, lines):
        self.steps, self.go, self.closed, self.polls = [], threading.Event(), 0, 0
        super().__init__("held", lines.append)

    def handle(self, item):
        self.steps.append(item)
        self.go.wait(20)

    def idle(self):
        self.polls += 1

    def finish(self):
        self.closed += 1


class Broken(Held):
    def handle(self, item):
        raise RuntimeError("no route\nto host")


def test_a_slow_bridge_gets_the_newest_step():
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


def test_a_bridge_that_hangs_is_left_behind():
    lines = []
    held = Held(lines)
    held(0)
    assert wait_for(lambda: held.steps == [0])
    held.close(0.05)
    assert lines == ["the bridge held hangs: left behind"]
    held.go.set()


def test_a_bridge_that_fails_ends_with_one_line_and_the_car_drives_on():
    lines, steps = [], []
    broken = Broken(lines)
    car = bare_loop(FilmCar(moving_world(40, RIG)), RIG, [steps.append, broken], controller="published")
    assert car.run(38.5 / 30) == 40
    assert wait_for(lambda: broken.closed == 1)
    assert lines == ["the bridge held has ended: RuntimeError: no route to host"]
    assert steps[-1].sent.speed > 0
    assert car.safe.faults[1:] == []  # the first is that nobody had started it


class PaperSettings(Strict):
    pages: int = 3


def test_another_bridge_is_a_class_a_table_and_a_function():
    made = []

    @bridge("paper")
    def open_paper(settings: PaperSettings, opening):
        made.append((settings.pages, Held([])))
        return made[-1][-1]

    try:
        with open_bridges({"paper": {"pages": 7}}, Opening(print, SimpleNamespace())):
            assert made[0][0] == 7
        assert made[0][1].closed == 1
        with pytest.raises(InputError, match="there is a bridge 'paper' already"):
            bridge("paper")(print)
    finally:
        del BRIDGES["paper"]


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"mavlnk": {}}, "bridge must be one of mavlink, .*got 'mavlnk'; did you mean mavlink"),
        ({"mavlink": {"device": "x", "bauds": 1}}, "bridges.mavlink: unknown key 'bauds'; did you mean baud?"),
        ({"ros2": {"peer": "<x/>"}}, "peer = '<x/>'"),
    ],
)
def test_bad_tables(tables, message):
    with pytest.raises(InputError, match=message):
        check({"board_name": "x", "simulation": {}, "bridges": tables}, RunConfig, "car.toml")


def test_the_nearest_of_each_sector():
    """Every place is in the sector whose middle is nearest to its bearing."""
    x, y = np.random.default_rng(3).normal(size=(2, 200))
    near = nearest_by_sector(x, y, 12)
    for n in range(12):
        bearing = np.angle(np.exp(1j * (np.arctan2(y, x) - n * math.pi / 6)))
        inside = np.abs(bearing) < math.pi / 12
        assert near[n] == (np.hypot(x, y)[inside].min() if inside.any() else math.inf)


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


def test_distances_and_odometry_reach_the_autopilot():
    """North-east-down turned: y and heading change their signs."""
    pytest.importorskip("pymavlink")
    port, (step, runner), lines = free_port(), known_step(), []
    autopilot = Autopilot(port)
    tables = {"mavlink": {"device": f"udpin:127.0.0.1:{port}"}}
    with open_bridges(tables, Opening(lines.append, runner)) as (mavlink,):
        assert wait_for(mavlink.connection.heard.is_set)
        mavlink(step._replace(state=None))
        for n in range(1, 4):
            assert wait_for(mavlink.queue.empty)
            mavlink(step._replace(restarted=n == 2))
            assert wait_for(lambda n=n: len(autopilot.of_type("ODOMETRY")) == n)
        distance, moved = autopilot.of_type("OBSTACLE_DISTANCE")[-1], autopilot.of_type("ODOMETRY")[-1]
        resets = [message.reset_counter for message in autopilot.of_type("ODOMETRY")]
    autopilot.close()
    assert (distance.time_usec, distance.increment, distance.frame) == (12_500_000, 5, 12)
    near = {5 * n: d for n, d in enumerate(distance.distances) if d != 65535}
    (left, a), (behind, b) = sorted(near.items(), key=lambda item: -item[0])
    assert left == pytest.approx(360 - math.degrees(math.atan2(0.4, 0.8)), abs=5.5)
    assert behind == pytest.approx(180 - math.degrees(math.atan2(0.6, 0.5)), abs=7)
    assert (a, b) == pytest.approx((89, 78), abs=7)
    assert (moved.x, moved.y, moved.vx, moved.yawspeed) == pytest.approx((1.0, -2.0, 0.4, -0.2))
    assert 2 * math.atan2(moved.q[3], moved.q[0]) == pytest.approx(-0.3)
    assert (moved.frame_id, moved.child_frame_id, resets, lines) == (20, 12, [0, 1, 1], [])


@pytest.fixture(scope="module")
def ros2():
    """What a process with message types of its own got of a known step, the runner, and when it began."""
    pytest.importorskip("cyclonedds")
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
    with open_bridges({"ros2": {"domain_id": domain}}, Opening(lines.append, runner)) as (thread,):
        words = [sys.executable, ros2_peer.__file__, str(domain)]
        peer = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        number, began = 0, time.time()
        while time.time() < began + 60 and not select.select([peer.stdout], [], [], 0.02)[0]:
            number += 1
            thread(step._replace(time=step.time + 0.05 * number))
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
    from ndtorch_robot.bridges.ros2 import wire_type
    from tests.robot.support import ros2_peer

    packages = {"LaserScan": "sensor", "Odometry": "nav"}
    types = wire_type(f"{packages.get(kind, 'geometry')}_msgs/msg/{kind}"), getattr(ros2_peer, f"{kind}_")
    for each in types:
        each.__idl__.populate()
        each.__idl__.fill_type_data()
    assert types[0].__idl__.get_type_id() == types[1].__idl__.get_type_id()
