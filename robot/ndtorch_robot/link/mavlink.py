"""The drive link to a rover with an autopilot, over MAVLink: ArduPilot Rover in its mode GUIDED."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from ndtorch.errors import InputError
from ndtorch_robot.link.link_drive import LOOP_PATIENCE, OLDEST_COMMAND
from ndtorch_robot.link.mavlink_connection import AUTOPILOT, MavlinkConnection, MavlinkSettings
from ndtorch_robot.link.registry import Opening, link
from ndtorch_robot.ports import STAND, Drive, DriveCommand, Report, SafeCommand, unseal

HEARTBEAT_PATIENCE = 2.5
"""Seconds without a heartbeat, which comes once a second, after which the autopilot counts as lost."""

MOTION_PATIENCE = 0.5
"""Seconds without the motion that it was asked to send after which it does."""

MOTION_RATE = 30
"""Times a second that the autopilot is asked for its motion."""

GUIDED = 15
"""Number of the mode GUIDED of ArduPilot Rover."""

MODES = {0: "MANUAL", 1: "ACRO", 3: "STEERING", 4: "HOLD", 5: "LOITER", 10: "AUTO", 11: "RTL", GUIDED: "GUIDED"}
"""Names of modes of ArduPilot Rover."""

VELOCITY_AND_YAW_RATE = 0x5C7
"""Type mask of a set-point: velocity and yaw rate count, all else does not."""

SLOW = 0.05
"""Below this speed the curvature is not known from the yaw rate, m/s."""

NOT_YET = "not yet told to drive"


class MavlinkDriveSettings(MavlinkSettings):
    """`[link]` with `kind = "mavlink"`.

    Args:
        arm: the car may arm the autopilot, and set its mode, when it is told to resume; else a person does both.
    """

    arm: bool = False


class MavlinkDrive(Drive):
    """A rover whose autopilot takes velocity set-points.

    It obeys while the autopilot is armed, in GUIDED, heard, and the loop sends commands. When one of these ends it
    stands until `resume`, and neither mode nor arming are changed by themselves: who switches to MANUAL drives.

    Args:
        connection: to the vehicle.
        arm: see `MavlinkDriveSettings`.
        report: called once for every event, with one line.
        now: the time, s.

    Raises:
        InputError: no heartbeat of the system, or an autopilot that is not ArduPilot.
    """

    def __init__(
        self,
        connection: MavlinkConnection,
        arm: bool = False,
        report: Report = print,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self.connection, self.arm, self.report, self.now = connection, arm, report, now
        self.lock = threading.RLock()
        self.standing, self.fault = True, NOT_YET
        self.last_command, self.last_sent = float("-inf"), STAND
        self.beat, self.moved = float("-inf"), float("-inf")
        self.armed, self.mode, self.kind, self.battery = False, -1, -1, 0.0
        self.yaw, self.yaw_rate, self.velocity = 0.0, 0.0, (0.0, 0.0)
        self.samples: list[tuple[float, float]] = []
        self.last_driven: DriveCommand | None = None
        self.trips: deque[float] = deque(maxlen=1000)
        self.timed = float("-inf")
        connection.listeners.append(self.handle)
        try:
            self.handle(connection.await_vehicle())
            if self.kind != connection.dialect.MAV_AUTOPILOT_ARDUPILOTMEGA:
                raise InputError(f"{connection.settings.device}: the autopilot is of kind {self.kind}, not ArduPilot")
        except BaseException:
            connection.listeners.remove(self.handle)
            raise
        connection.ticks.append(self.look_after)

    # What the loop calls.

    def send(self, command: SafeCommand) -> DriveCommand:
        """Drive like this, if the safety layer made it; returns what was sent, a stop when it does not obey."""
        wanted, now = unseal(command), self.now()
        with self.lock:
            self.last_command = now
            obeys = not self.standing and self.why_not() is None and now - command.time <= OLDEST_COMMAND
            sent = wanted if obeys else STAND
            self.last_sent = sent if self.set_point(sent) else STAND
            return self.last_sent

    def set_point(self, command: DriveCommand) -> bool:
        """x is ahead and yaw rates are clockwise in the frame of the body of MAVLink."""
        c = self.connection
        speed, turn = command.speed, -command.speed * command.curvature
        frame = c.dialect.MAV_FRAME_BODY_NED
        about = (c.boot_ms(), c.settings.system_id, AUTOPILOT, frame, VELOCITY_AND_YAW_RATE)
        return c.send("set_position_target_local_ned", *about, 0, 0, 0, speed, 0, 0, 0, 0, 0, 0, turn)

    def stop(self) -> None:
        """A set-point of 0, and no other until `resume`; the autopilot brakes as it is set to."""
        self.standing = True
        self.set_point(STAND)

    def resume(self) -> bool:
        """Obey again if the autopilot does; where it may, it is armed and set to GUIDED, which takes until the next
        attempt."""
        with self.lock:
            now = self.now()
            if self.lost(now) is not None:
                return False
            d = self.connection.dialect
            if self.arm and self.mode != GUIDED:
                self.connection.ask(d.MAV_CMD_DO_SET_MODE, d.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, GUIDED)
            if self.arm and not self.armed:
                self.connection.ask(d.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            reason = self.why_not()
            self.fault = reason or ""
            self.standing = reason is not None
            self.last_command = now
            return reason is None

    def lost(self, now: float) -> str | None:
        if now - self.beat > HEARTBEAT_PATIENCE:
            return f"lost: no heartbeat of the autopilot for {now - self.beat:.1f} s"
        if now - self.moved > MOTION_PATIENCE and self.moved > float("-inf"):
            return f"lost: no motion from the autopilot for {now - self.moved:.1f} s"
        return None

    def why_not(self) -> str | None:
        """Why the autopilot does not obey now."""
        lost = self.lost(self.now())
        if lost is not None:
            return lost
        if not self.armed:
            return "the autopilot is disarmed"
        if self.mode != GUIDED:
            return f"the autopilot is in mode {MODES.get(self.mode, self.mode)}, not GUIDED"
        return None

    def trouble(self) -> str | None:
        """Why the rover does not obey, other than after `stop`; None when all is well."""
        return self.fault or None

    def driven(self) -> DriveCommand:
        """Mean of the speeds and curvatures that the autopilot measured since this was last asked; what was sent,
        where it does not measure."""
        with self.lock:
            samples, self.samples = self.samples, []
            if samples:
                speed, turn = (sum(part) / len(samples) for part in zip(*samples, strict=True))
                self.last_driven = DriveCommand(speed, turn / speed if abs(speed) > SLOW else 0.0)
            return self.last_sent if self.last_driven is None else self.last_driven

    def telemetry(self) -> dict[str, Any]:
        """State of the autopilot; `link` is why it cannot be commanded, or None."""
        mode = MODES.get(self.mode, str(self.mode))
        return {"armed": self.armed, "mode": mode, "battery_v": self.battery, "link": self.trouble()}

    def round_trips(self) -> Sequence[float]:
        """From a TIMESYNC to its answer, s."""
        return self.trips

    def close(self) -> None:
        if self.handle in self.connection.listeners:
            self.stop()
            self.connection.ticks.remove(self.look_after)
            self.connection.listeners.remove(self.handle)
            self.connection.close()

    # The reading thread.

    def look_after(self) -> None:
        """Stop where the loop is silent or the autopilot has ended to obey; ask for motion; measure the round trip."""
        now, d = self.now(), self.connection.dialect
        with self.lock:
            why = self.why_not()
            if not self.standing and why is None and now - self.last_command > LOOP_PATIENCE:
                why = f"the loop has sent nothing for {now - self.last_command:.2f} s"
            news = why is not None and not self.standing
            if news:
                self.fault = str(why)
                self.stop()
        if news:
            self.report(f"link: {why}")
        if now - self.timed > 1.0:
            self.timed = now
            self.connection.send("timesync", 0, time.monotonic_ns())
            if now - self.moved > MOTION_PATIENCE:
                for message in (d.MAVLINK_MSG_ID_ATTITUDE, d.MAVLINK_MSG_ID_LOCAL_POSITION_NED):
                    self.connection.ask(d.MAV_CMD_SET_MESSAGE_INTERVAL, message, 1e6 / MOTION_RATE)

    def handle(self, message: Any) -> None:
        kind, now = message.get_type(), self.now()
        with self.lock:
            if kind == "HEARTBEAT":
                self.beat, self.mode, self.kind = now, message.custom_mode, message.autopilot
                self.armed = bool(message.base_mode & self.connection.dialect.MAV_MODE_FLAG_SAFETY_ARMED)
            elif kind == "ATTITUDE":
                self.yaw, self.yaw_rate = message.yaw, message.yawspeed
            elif kind == "LOCAL_POSITION_NED":
                self.moved = now
                ahead = message.vx * math.cos(self.yaw) + message.vy * math.sin(self.yaw)
                self.samples = [*self.samples[-99:], (ahead, -self.yaw_rate)]
            elif kind == "SYS_STATUS":
                self.battery = message.voltage_battery / 1e3
            elif kind == "TIMESYNC" and message.tc1:
                self.trips.append((time.monotonic_ns() - message.ts1) / 1e9)
        if kind == "COMMAND_ACK" and message.result not in (0, 5):
            self.report(f"link: the autopilot refuses command {message.command} (result {message.result})")


@link("mavlink", MavlinkDriveSettings)
def open_mavlink(settings: MavlinkDriveSettings, opening: Opening) -> MavlinkDrive:
    connection = MavlinkConnection.open(settings)
    try:
        return MavlinkDrive(connection, settings.arm, opening.report)
    except BaseException:
        connection.close()
        raise
