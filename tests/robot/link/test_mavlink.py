"""The drive link to an autopilot, against a scripted one on UDP; the time of the link is the test's."""

import math

import pytest

pytest.importorskip("pymavlink")

from ndtorch.errors import InputError
from ndtorch_robot.link import mavlink_connection
from ndtorch_robot.link.mavlink import MavlinkDrive
from ndtorch_robot.link.mavlink_connection import MavlinkConnection, MavlinkSettings
from ndtorch_robot.ports import _SEAL, STAND, DriveCommand, SafeCommand
from ndtorch_robot.safety import SafeDrive
from tests.robot.support.autopilot import GUIDED, Autopilot, free_port, wait_for


class Rig:
    """A drive, its autopilot and a clock that stands."""

    def __init__(self, arm=False, **autopilot):
        self.time, self.lines = 100.0, []
        port = free_port()
        self.autopilot = Autopilot(port, **autopilot)
        self.connection = MavlinkConnection.open(MavlinkSettings(device=f"udpin:127.0.0.1:{port}"))
        try:
            self.drive = MavlinkDrive(self.connection, arm, self.lines.append, lambda: self.time)
        except BaseException:
            self.connection.close()
            self.autopilot.close()
            raise

    def send(self, speed, curvature=0.0):
        return self.drive.send(SafeCommand(DriveCommand(speed, curvature), self.time, _SEAL))

    def resume(self):
        return wait_for(self.drive.resume)

    def later(self, seconds, tell=True):
        """Some time later; the autopilot was heard since, or was not."""
        self.time += seconds
        assert not tell or wait_for(lambda: self.drive.beat == self.drive.moved == self.time)

    def silence(self):
        """The autopilot falls silent, and what it sent before has arrived."""
        assert wait_for(lambda: len(self.drive.round_trips()) > 0)  # that of the start
        self.autopilot.beats, trips = False, len(self.drive.round_trips())
        self.drive.timed = -math.inf
        assert wait_for(lambda: len(self.drive.round_trips()) > trips)

    def close(self):
        self.drive.close()
        self.autopilot.close()


@pytest.fixture
def opened():
    rigs = []

    def make(**options):
        rigs.append(Rig(**options))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.close()


def test_velocity_set_points_in_the_frame_of_the_body(opened):
    """x ahead; a curve to the left is a negative yaw rate, because MAVLink turns clockwise about down."""
    rig = opened()
    assert rig.send(0.4) == STAND  # not yet told to drive
    assert rig.drive.trouble() == "not yet told to drive"
    assert rig.resume()
    assert rig.drive.trouble() is None
    assert rig.send(0.4, 0.5) == (0.4, 0.5)
    assert wait_for(lambda: rig.autopilot.motion == pytest.approx((0.4, -0.2)))
    message = rig.autopilot.of_type("SET_POSITION_TARGET_LOCAL_NED")[-1]
    assert (message.coordinate_frame, message.type_mask) == (8, 0b010111000111)
    assert (message.target_system, message.get_srcSystem(), message.get_srcComponent()) == (1, 1, 191)
    rig.send(-0.3, 0.5)
    assert wait_for(lambda: rig.autopilot.motion == pytest.approx((-0.3, 0.15)))


def test_what_it_drove_comes_from_velocity_and_yaw(opened):
    rig = opened()
    rig.resume()
    rig.send(0.4, 0.5)
    assert wait_for(lambda: rig.drive.driven() == pytest.approx((0.4, 0.5), abs=1e-6))
    told = {"armed": True, "mode": "GUIDED", "battery_v": 12.6, "link": None}
    assert wait_for(lambda: rig.drive.telemetry() == told)
    assert wait_for(lambda: len(rig.drive.round_trips()) > 0)
    assert all(trip >= 0 for trip in rig.drive.round_trips())


def test_a_lost_heartbeat_stands_until_resume(opened):
    rig = opened()
    rig.resume()
    rig.send(0.4)
    rig.silence()
    rig.drive.last_command = rig.time + 0.6
    rig.later(0.6, tell=False)
    assert wait_for(lambda: rig.drive.trouble() is not None)
    assert "no motion from the autopilot for 0.6 s" in rig.drive.trouble()
    rig.later(2.0, tell=False)
    assert not rig.drive.resume()
    assert rig.send(0.4) == STAND
    assert wait_for(lambda: rig.autopilot.motion == (0.0, 0.0))
    rig.autopilot.beats = True
    assert wait_for(lambda: rig.drive.why_not() is None)
    assert rig.send(0.4) == STAND  # it does not go on by itself
    assert rig.resume()
    assert rig.send(0.4).speed == 0.4
    assert [line[:10] for line in rig.lines] == ["link: lost"]


def test_a_heartbeat_alone_can_be_lost(opened):
    rig = opened()
    rig.silence()
    rig.drive.moved = math.inf
    assert rig.drive.lost(rig.drive.beat + 2.4) is None
    assert "no heartbeat of the autopilot for 2.6 s" in (rig.drive.lost(rig.drive.beat + 2.6) or "")


@pytest.mark.parametrize(
    ("change", "words"), [({"mode": 0}, "in mode MANUAL, not GUIDED"), ({"armed": False}, "the autopilot is disarmed")]
)
def test_who_takes_over_drives(opened, change, words):
    """Mode or arming change: it stands, sends nothing but stands, and changes neither back by itself."""
    rig = opened(arm=True)
    rig.resume()
    rig.send(0.4)
    vars(rig.autopilot).update(change)
    assert wait_for(lambda: words in (rig.drive.trouble() or ""))
    asked = len([m for m in rig.autopilot.of_type("COMMAND_LONG") if m.command in (176, 400)])
    for _ in range(5):
        assert rig.send(0.4) == STAND
    rig.later(1.0)
    assert len([m for m in rig.autopilot.of_type("COMMAND_LONG") if m.command in (176, 400)]) == asked
    assert rig.resume()  # a person said so, and it may arm
    assert (rig.autopilot.mode, rig.autopilot.armed) == (GUIDED, True)


def test_without_leave_it_neither_arms_nor_changes_the_mode(opened):
    rig = opened(armed=False, mode=4)
    assert not rig.drive.resume()
    assert rig.drive.trouble() == "the autopilot is disarmed"
    rig.autopilot.armed = True
    assert wait_for(lambda: not rig.drive.resume() and "in mode HOLD" in rig.drive.trouble())
    assert not [m for m in rig.autopilot.of_type("COMMAND_LONG") if m.command in (176, 400)]


def test_a_refusal_is_said(opened):
    rig = opened(arm=True, armed=False)
    rig.autopilot.obedient = False
    assert not rig.drive.resume()
    assert wait_for(lambda: "link: the autopilot refuses command 400 (result 4)" in rig.lines)


def test_a_silent_loop_stands(opened):
    rig = opened()
    rig.resume()
    rig.send(0.4)
    assert wait_for(lambda: rig.autopilot.motion[0] > 0)
    rig.later(0.13)
    assert wait_for(lambda: rig.autopilot.motion == (0.0, 0.0))
    assert "the loop has sent nothing for 0.13 s" in rig.drive.trouble()


def test_other_systems_are_not_listened_to(opened):
    rig = opened()
    rig.resume()
    other = Autopilot(int(rig.connection.settings.device.rsplit(":")[-1]), system=7, mode=0, armed=False)
    try:
        assert wait_for(lambda: 7 in rig.connection.others)
        rig.later(0.01)
        assert rig.drive.why_not() is None
        assert rig.send(0.3).speed == 0.3
    finally:
        other.close()


def test_no_such_system(monkeypatch):
    monkeypatch.setattr(mavlink_connection, "GREETING", 0.3)
    with pytest.raises(InputError, match="no heartbeat of system 1; heard systems 7"):
        Rig(system=7)
    assert not MavlinkConnection.open_ones


def test_another_kind_of_autopilot():
    with pytest.raises(InputError, match="the autopilot is of kind 12, not ArduPilot"):
        Rig(kind=12)


def test_a_port_in_use_or_no_port():
    with pytest.raises(InputError, match="cannot be opened"):
        MavlinkConnection.open(MavlinkSettings(device="udpin:127.0.0.1"))
    with pytest.raises(InputError, match="cannot be opened"):
        MavlinkConnection.open(MavlinkSettings(device="/dev/nothing-there"))


def test_the_safety_layer_resumes_it_when_it_is_armed(opened):
    """`resume` is kept until the autopilot obeys, and a takeover needs another one."""
    rig = opened(armed=False)
    clock = type("Clock", (), {"now": lambda self: rig.time, "wait_until": lambda self, time: None})()
    safe = SafeDrive(rig.drive, clock)
    safe.resume(patience=None)
    assert safe.send(DriveCommand(0.4, 0.0)) == STAND
    rig.autopilot.armed = True
    assert wait_for(lambda: rig.drive.why_not() is None)
    rig.later(1.1)
    safe.send(DriveCommand(0.4, 0.0))
    assert safe.send(DriveCommand(0.4, 0.0)).speed == 0.4
    rig.autopilot.mode = 0
    assert wait_for(lambda: rig.drive.trouble() is not None)
    assert safe.send(DriveCommand(0.4, 0.0)) == STAND
    rig.autopilot.mode = GUIDED
    assert wait_for(lambda: rig.drive.why_not() is None)
    rig.later(5.0)
    assert safe.send(DriveCommand(0.4, 0.0)) == STAND
