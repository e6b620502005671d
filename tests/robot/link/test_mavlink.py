"""The drive link to an autopilot, against a scripted one on UDP; the time of the link is the test's."""

import math
import time

import pytest

pytest.importorskip("pymavlink")

from ndtorch.errors import InputError
from ndtorch_robot.link import mavlink
from ndtorch_robot.link.mavlink import MavlinkDrive, MavlinkSettings
from ndtorch_robot.ports import _SEAL, STAND, DriveCommand, SafeCommand
from ndtorch_robot.safety import SafeDrive
from tests.robot.support.autopilot import GUIDED, Autopilot, free_port, wait_for


class Rig:
    """A drive, its autopilot and a clock that stands."""

    def __init__(self, **autopilot):
        self.time, self.lines = 100.0, []
        port = free_port()
        self.autopilot = Autopilot(port, **autopilot)
        settings = MavlinkSettings(device=f"udpin:127.0.0.1:{port}")
        try:
            self.drive = MavlinkDrive(settings, self.lines.append, lambda: self.time)
        except BaseException:
            self.autopilot.close()
            raise

    def send(self, speed, curvature=0.0):
        return self.drive.send(SafeCommand(DriveCommand(speed, curvature), self.time, _SEAL))

    def resume(self):
        return wait_for(self.drive.resume)

    def later(self, seconds):
        """Some time later; the autopilot was heard since."""
        self.time += seconds
        assert wait_for(lambda: self.drive.age("HEARTBEAT") == self.drive.age("LOCAL_POSITION_NED") == 0)

    def quiet(self):
        """Nothing has come for a moment."""
        message = self.drive.latest.pop("SYS_STATUS", None)
        time.sleep(0.05)
        return message is not None and "SYS_STATUS" not in self.drive.latest

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
    assert rig.send(0.4) == STAND  # not resumed yet
    assert rig.resume()
    assert rig.drive.trouble() is None
    assert rig.send(0.4, 0.5) == (0.4, 0.5)
    assert wait_for(lambda: rig.autopilot.motion == pytest.approx((0.4, -0.2)))
    message = rig.autopilot.of_type("SET_POSITION_TARGET_LOCAL_NED")[-1]
    assert (message.coordinate_frame, message.type_mask) == (8, 0b010111000111)
    assert (message.target_system, message.get_srcSystem(), message.get_srcComponent()) == (1, 1, 191)
    assert wait_for(lambda: rig.drive.driven() == pytest.approx((0.4, 0.5), abs=1e-6))
    state = {"armed": True, "mode": GUIDED, "battery_v": 12.6, "link": None}
    assert wait_for(lambda: rig.drive.telemetry() == state)


def test_a_lost_autopilot_stands_until_resume(opened):
    rig = opened()
    rig.resume()
    rig.send(0.4)
    rig.autopilot.beats = False
    assert wait_for(rig.quiet)  # what it sent before has arrived
    rig.drive.commanded = rig.time + 0.6
    rig.time += 0.6
    assert wait_for(lambda: "no motion from the autopilot for 0.6 s" in (rig.drive.trouble() or ""))
    rig.time += 2.0
    assert "no heartbeat of the autopilot for 2.6 s" in rig.drive.why_not()
    assert not rig.drive.resume()
    assert rig.send(0.4) == STAND
    assert wait_for(lambda: rig.autopilot.motion == (0.0, 0.0))
    rig.autopilot.beats = True
    assert wait_for(lambda: rig.drive.why_not() is None)
    assert rig.send(0.4) == STAND  # it does not go on by itself
    assert rig.resume()
    assert rig.send(0.4).speed == 0.4
    assert [line[:10] for line in rig.lines] == ["link: lost"]


@pytest.mark.parametrize(
    ("change", "words"), [({"mode": 0}, "in mode 0, not GUIDED"), ({"armed": False}, "the autopilot is disarmed")]
)
def test_who_takes_over_drives(opened, change, words):
    """Mode or arming change: it stands, sends nothing but stands, and changes neither back by itself."""
    rig = opened()
    rig.resume()
    rig.send(0.4)
    vars(rig.autopilot).update(change)
    assert wait_for(lambda: words in (rig.drive.trouble() or ""))
    assert {rig.send(0.4) for _ in range(5)} == {STAND}
    rig.later(1.0)
    assert {m.command for m in rig.autopilot.of_type("COMMAND_LONG")} <= {511}  # asks for messages alone


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
    other = Autopilot(int(rig.drive.settings.device.rsplit(":")[-1]), system=7, mode=0, armed=False)
    try:
        rig.later(0.01)
        assert rig.send(0.3).speed == 0.3
    finally:
        other.close()


def test_what_cannot_be_opened(monkeypatch):
    monkeypatch.setattr(mavlink, "GREETING", 0.3)
    with pytest.raises(InputError, match="no heartbeat of system 1"):
        Rig(system=7)
    for device in ("udpin:127.0.0.1", "/dev/nothing-there"):
        with pytest.raises(InputError, match="cannot be opened"):
            MavlinkDrive(MavlinkSettings(device=device))


def test_the_safety_layer_resumes_it_when_it_is_armed(opened):
    """`resume` is kept until the autopilot obeys, and a takeover needs another one."""
    rig = opened(armed=False)
    clock = type("Clock", (), {"now": lambda self: rig.time, "wait_until": lambda self, time: None})()
    safe = SafeDrive(rig.drive, clock)
    safe.stop()
    safe.resume(patience=math.inf)
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
