"""The bridge to MAVLink: what an autopilot hears on UDP, and commands from it."""

import math

import numpy as np
import pytest

pytest.importorskip("pymavlink")

from ndtorch_robot.bridges import Opening, Wish, open_bridges
from ndtorch_robot.bridges.mavlink import sector_distances
from ndtorch_robot.link.mavlink_connection import MavlinkConnection
from ndtorch_robot.obstacles import nearest_by_sector, seen_obstacles
from tests.robot.support.autopilot import Autopilot, free_port, wait_for
from tests.robot.support.cars import known_step


def test_the_nearest_of_each_sector():
    """Every place is in the sector whose middle is nearest to its bearing."""
    rng = np.random.default_rng(3)
    x, y = rng.normal(size=(2, 200))
    near = nearest_by_sector(x, y, 12)
    for n in range(12):
        bearing = np.angle(np.exp(1j * (np.arctan2(y, x) - n * math.pi / 6)))
        inside = np.abs(bearing) < math.pi / 12
        assert near[n] == (np.hypot(x, y)[inside].min() if inside.any() else math.inf)


def test_sectors_of_obstacle_distance_go_clockwise():
    """Sector 0 is ahead, 18 to the right; nothing known is UINT16_MAX."""
    cm = sector_distances(np.array([2.0, 0.0, -1.0]), np.array([0.0, -0.5, 0.0]))
    assert {n: d for n, d in enumerate(cm) if d != 65535} == {0: 200, 18: 50, 36: 100}
    assert sector_distances(np.array([700.0]), np.array([0.0]))[0] == 65534


@pytest.mark.parametrize("pose", [(1.0, 2.0, 0.3), (-7.3, 40.2, 2.5), (0.0, 0.0, 0.0)])
def test_remembered_obstacles_are_where_they_were_seen(pose):
    """Within half the diagonal of a cell of 8 cm, in the body frame, wherever the car is."""
    places = ((0.8, 0.4), (-0.5, -0.6), (1.5, -1.0))
    step, runner = known_step(pose, places)
    seen = seen_obstacles(step.state, runner.navigator)
    found = np.stack((seen.x, seen.y), 1)
    assert len(found) == len(places)
    for place in places:
        assert np.hypot(*(found - place).T).min() <= 0.04 * math.sqrt(2) + 1e-6


def test_a_controller_without_a_grid_has_ranges_alone():
    step, runner = known_step()
    assert seen_obstacles(step.state._replace(control=None), runner.navigator).x.shape == (0,)


@pytest.fixture
def bridged():
    port, (step, runner) = free_port(), known_step()
    autopilot, lines = Autopilot(port), []
    opening = Opening("x", lines.append, runner, {"kind": "mavlink", "device": f"udpin:127.0.0.1:{port}"}, Wish())
    with open_bridges({"mavlink": {}}, opening) as (thread,):
        connection = thread.bridge.connection
        assert wait_for(connection.heard.is_set)
        yield thread, step, opening, autopilot, lines
    autopilot.close()
    assert not MavlinkConnection.open_ones


def test_distances_and_odometry_reach_the_autopilot(bridged):
    thread, step, _, autopilot, lines = bridged
    for n in range(1, 4):
        thread(step._replace(restarted=n == 2))
        assert wait_for(lambda n=n: len(autopilot.of_type("ODOMETRY")) == n)
    assert wait_for(lambda: len(autopilot.of_type("OBSTACLE_DISTANCE")) == 3)
    distance, moved = autopilot.of_type("OBSTACLE_DISTANCE")[-1], autopilot.of_type("ODOMETRY")[-1]
    assert (distance.time_usec, distance.increment, distance.frame) == (12_500_000, 5, 12)
    near = {5 * n: d for n, d in enumerate(distance.distances) if d != 65535}
    (left, a), (behind, b) = sorted(near.items(), key=lambda item: -item[0])
    # Clockwise from ahead, by the bearing of the cell that holds the place.
    assert left == pytest.approx(360 - math.degrees(math.atan2(0.4, 0.8)), abs=5.5)
    assert behind == pytest.approx(180 - math.degrees(math.atan2(0.6, 0.5)), abs=7)
    assert (a, b) == pytest.approx((89, 78), abs=7)
    # North-east-down turned: y and heading change their signs.
    assert (moved.x, moved.y, moved.vx, moved.yawspeed) == pytest.approx((1.0, -2.0, 0.4, -0.2))
    w, _, _, z = moved.q
    assert 2 * math.atan2(z, w) == pytest.approx(-0.3)
    assert [message.reset_counter for message in autopilot.of_type("ODOMETRY")] == [0, 1, 1]
    assert (moved.frame_id, moved.child_frame_id) == (20, 12)
    assert lines == []


def test_commands_from_outside_are_wishes(bridged):
    _, _, opening, autopilot, _ = bridged
    mav = autopilot.line.mav
    mav.set_position_target_local_ned_send(0, 1, 191, 8, 0x5C7, 0, 0, 0, 0.3, 0, 0, 0, 0, 0, 0, -0.15)
    assert wait_for(lambda: opening.wish.newest[0] == pytest.approx((0.3, 0.5)))
    mav.set_position_target_local_ned_send(0, 1, 1, 8, 0x5C7, 0, 0, 0, 0.1, 0, 0, 0, 0, 0, 0, 0)  # not for us
    mav.set_position_target_local_ned_send(0, 1, 191, 1, 0x5C7, 0, 0, 0, 0.1, 0, 0, 0, 0, 0, 0, 0)  # not of the body
    mav.manual_control_send(1, 1000, 0, 0, -500, 0)
    assert wait_for(lambda: opening.wish.newest[0] == pytest.approx((0.5, 1.0)))


def test_a_step_without_a_state_says_nothing(bridged):
    thread, step, _, autopilot, _ = bridged
    thread(step._replace(state=None))
    assert wait_for(lambda: thread.taken == 1)
    assert not autopilot.of_type("ODOMETRY")
