"""The drive link to a rover with an autopilot, over MAVLink: ArduPilot Rover in its mode GUIDED."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable
from typing import Annotated, Any, ClassVar

from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.utils.packages import need
from ndtorch.utils.toml import Strict
from ndtorch_robot.link import Opening, link
from ndtorch_robot.link.link_drive import LOOP_PATIENCE, OLDEST_COMMAND
from ndtorch_robot.ports import STAND, Drive, DriveCommand, Report, SafeCommand, unseal

COMPONENT, AUTOPILOT = 191, 1
"""MAV_COMP_ID_ONBOARD_COMPUTER, which this program is in the system of the vehicle, and MAV_COMP_ID_AUTOPILOT1."""

GREETING, HEARTBEAT_EVERY, TICK = 5.0, 1.0, 0.02
"""Seconds to wait for the vehicle, between two heartbeats, and after which the thread looks after the drive."""

HEARTBEAT_PATIENCE, MOTION_PATIENCE = 2.5, 0.5
"""Seconds without a heartbeat, which comes once a second, and without motion, after which the autopilot is lost."""

MOTION_RATE = 30
"""Times a second that the autopilot is asked for its motion."""

GUIDED = 15
MODES = {0: "MANUAL", 1: "ACRO", 3: "STEERING", 4: "HOLD", 5: "LOITER", 10: "AUTO", 11: "RTL", GUIDED: "GUIDED"}
"""Modes of ArduPilot Rover."""

VELOCITY_AND_YAW_RATE = 0x5C7
"""Type mask of a set-point: velocity and yaw rate count, all else does not."""

SLOW = 0.05
"""Below this speed the curvature is not known from the yaw rate, m/s."""


class MavlinkSettings(Strict):
    """A connection to a vehicle.

    Args:
        device: `udpin:ADDRESS:PORT`, `udpout:ADDRESS:PORT`, `tcp:ADDRESS:PORT` or a serial port, as of pymavlink.
        baud: symbols a second of a serial port.
        system_id: of the vehicle; what other systems send is not listened to.
    """

    device: str = "udpin:127.0.0.1:14550"
    baud: Annotated[int, Field(ge=1200, le=4_000_000)] = 921_600
    system_id: Annotated[int, Field(ge=1, le=255)] = 1


class MavlinkDriveSettings(MavlinkSettings):
    """`[link]` with `kind = "mavlink"`.

    Args:
        arm: the car may arm the autopilot, and set its mode, when it is resumed; else a person does both.
    """

    arm: bool = False


class MavlinkConnection:
    """A connection to the autopilot of one vehicle, which a link and a bridge share; a thread reads, anybody sends.

    Attributes:
        dialect: the module with the messages and constants of MAVLink 2.
        heartbeat: the last one of the autopilot; None before any.
        others: systems that were heard and are not listened to.
        drive: is given the messages and looked after.
    """

    open_ones: ClassVar[dict[str, MavlinkConnection]] = {}

    def __init__(self, settings: MavlinkSettings) -> None:
        os.environ.setdefault("MAVLINK20", "1")
        mavutil = need("pymavlink.mavutil", "MAVLink")
        self.dialect = need("pymavlink.dialects.v20.common", "MAVLink")
        self.settings, self.users, self.begun = settings, 0, time.monotonic()
        try:
            self.port = mavutil.mavlink_connection(
                settings.device,
                baud=settings.baud,
                source_system=settings.system_id,
                source_component=COMPONENT,
                dialect="common",
                autoreconnect=True,
            )
        except (OSError, ValueError, IndexError) as error:
            raise InputError(f"{settings.device}: cannot be opened ({error})") from None
        self.others, self.heartbeat = set[int](), None
        self.lock, self.closing, self.heard = threading.Lock(), threading.Event(), threading.Event()
        self.drive: MavlinkDrive | None = None
        self.thread = threading.Thread(target=self.listen, name="mavlink", daemon=True)
        self.thread.start()

    @classmethod
    def open(cls, settings: MavlinkSettings) -> MavlinkConnection:
        """The connection to that device, new or shared; each `open` wants a `close`."""
        if settings.device not in cls.open_ones:
            cls.open_ones[settings.device] = cls(settings)
        connection = cls.open_ones[settings.device]
        connection.users += 1
        return connection

    def close(self) -> None:
        """Give it back; the last user closes it."""
        self.users -= 1
        if self.users or self.closing.is_set():
            return
        self.open_ones.pop(self.settings.device, None)
        self.closing.set()
        self.thread.join(2.0)
        self.port.close()

    def send(self, name: str, *values: Any) -> bool:
        """Send the message of this name, such as `"heartbeat"`; False where the port is gone."""
        with self.lock:
            try:
                getattr(self.port.mav, f"{name}_send")(*values)
            except OSError:
                return False
        return True

    def ask(self, command: int, *params: float) -> bool:
        """Send a COMMAND_LONG to the autopilot."""
        seven = (*params, *[0.0] * (7 - len(params)))
        return self.send("command_long", self.settings.system_id, AUTOPILOT, command, 0, *seven)

    def listen(self) -> None:
        beaten, d = -math.inf, self.dialect
        while not self.closing.is_set():
            now = time.monotonic()
            if now - beaten >= HEARTBEAT_EVERY:
                beaten = now
                self.send("heartbeat", d.MAV_TYPE_ONBOARD_CONTROLLER, d.MAV_AUTOPILOT_INVALID, 0, 0, 4)
            if self.drive is not None:
                self.drive.look_after()
            try:
                self.port.select(TICK)
                while (message := self.port.recv_msg()) is not None:
                    self.dispatch(message)
            except OSError:  # a serial port is opened anew by pymavlink; the silence is noticed by the drive
                self.closing.wait(TICK)

    def dispatch(self, message: Any) -> None:
        system, heartbeat = message.get_srcSystem(), message.get_type() == "HEARTBEAT"
        if system != self.settings.system_id:
            self.others |= {system} if heartbeat else set()
        elif message.get_srcComponent() == AUTOPILOT and message.get_type() != "BAD_DATA":
            if self.drive is not None:
                self.drive.handle(message)
            if heartbeat:
                self.heartbeat = message
                self.heard.set()


class MavlinkDrive(Drive):
    """A rover whose autopilot takes velocity set-points.

    It obeys while the autopilot is armed, in GUIDED, heard, and the loop sends commands. When one of these ends it
    stands until `resume`, and neither mode nor arming are changed by themselves: who switches to MANUAL drives.

    Args:
        connection: to the vehicle; closed with the drive.
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
        self.standing, self.fault, self.sent, self.commanded = True, "", STAND, -math.inf
        self.armed, self.mode, self.battery, self.yaw, self.yaw_rate = False, -1, 0.0, 0.0, 0.0
        self.beat = self.moved = self.asked = -math.inf
        self.samples: list[tuple[float, float]] = []
        self.measured: DriveCommand | None = None
        device, vehicle = connection.settings.device, connection.settings.system_id
        if not connection.heard.wait(GREETING):
            heard = f"; heard systems {', '.join(map(str, sorted(connection.others)))}" if connection.others else ""
            raise InputError(f"{device}: no heartbeat of system {vehicle}{heard}")
        first: Any = connection.heartbeat
        if first.autopilot != connection.dialect.MAV_AUTOPILOT_ARDUPILOTMEGA:
            raise InputError(f"{device}: the autopilot is of kind {first.autopilot}, not ArduPilot")
        self.handle(first)
        connection.drive = self

    def send(self, command: SafeCommand) -> DriveCommand:
        """Drive like this; returns what was sent, a stop when it does not obey."""
        wanted, now = unseal(command), self.now()
        with self.lock:
            self.commanded = now
            obeys = not self.standing and self.why_not() is None and now - command.time <= OLDEST_COMMAND
            self.sent = wanted if obeys and self.set_point(wanted) else STAND
            if not obeys:
                self.set_point(STAND)
            return self.sent

    def set_point(self, command: DriveCommand) -> bool:
        """x is ahead and yaw rates are clockwise in the frame of the body of MAVLink."""
        c = self.connection
        boot_ms = int((time.monotonic() - c.begun) * 1e3) & 0xFFFFFFFF
        about = (boot_ms, c.settings.system_id, AUTOPILOT, c.dialect.MAV_FRAME_BODY_NED, VELOCITY_AND_YAW_RATE)
        turn = -command.speed * command.curvature
        return c.send("set_position_target_local_ned", *about, 0, 0, 0, command.speed, 0, 0, 0, 0, 0, 0, turn)

    def stop(self) -> None:
        """A set-point of 0, and no other until `resume`; the autopilot brakes as it is set to."""
        self.standing = True
        self.set_point(STAND)

    def resume(self) -> bool:
        """Obey again if the autopilot does.

        Where it may, it is armed and set to GUIDED, which takes until the next attempt.
        """
        with self.lock:
            d, reason = self.connection.dialect, self.why_not()
            if self.arm and reason is not None and not reason.startswith("lost"):
                self.connection.ask(d.MAV_CMD_DO_SET_MODE, d.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, GUIDED)
                self.connection.ask(d.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            self.fault, self.standing, self.commanded = reason or "", reason is not None, self.now()
            return reason is None

    def why_not(self) -> str | None:
        """Why the autopilot does not obey now."""
        now = self.now()
        if now - self.beat > HEARTBEAT_PATIENCE:
            return f"lost: no heartbeat of the autopilot for {now - self.beat:.1f} s"
        if MOTION_PATIENCE < now - self.moved < math.inf:
            return f"lost: no motion from the autopilot for {now - self.moved:.1f} s"
        if not self.armed:
            return "the autopilot is disarmed"
        if self.mode != GUIDED:
            return f"the autopilot is in mode {MODES.get(self.mode, self.mode)}, not GUIDED"
        return None

    def trouble(self) -> str | None:
        """Why the rover does not obey, other than after `stop`; None when all is well."""
        return self.fault or None

    def driven(self) -> DriveCommand:
        """Mean of the speeds and curvatures that the autopilot measured since the last call; what was sent, where it
        does not measure.
        """
        with self.lock:
            samples, self.samples = self.samples, []
            if samples:
                speed, turn = (sum(part) / len(samples) for part in zip(*samples, strict=True))
                self.measured = DriveCommand(speed, turn / speed if abs(speed) > SLOW else 0.0)
            return self.measured or self.sent

    def telemetry(self) -> dict[str, Any]:
        """State of the autopilot; `link` is why it cannot be commanded, or None."""
        mode = MODES.get(self.mode, str(self.mode))
        return {"armed": self.armed, "mode": mode, "battery_v": self.battery, "link": self.trouble()}

    def close(self) -> None:
        if self.connection.drive is self:
            self.stop()
            self.connection.drive = None
            self.connection.close()

    def look_after(self) -> None:
        """Stop where the loop is silent or the autopilot does not obey any more; ask for motion where none comes."""
        now, d = self.now(), self.connection.dialect
        with self.lock:
            why = self.why_not()
            if why is None and now - self.commanded > LOOP_PATIENCE:
                why = f"the loop has sent nothing for {now - self.commanded:.2f} s"
            if why is not None and not self.standing:
                self.fault = why
                self.stop()
                self.report(f"link: {why}")
        if now - self.moved > MOTION_PATIENCE and now - self.asked > 1.0:
            self.asked = now
            for message in (d.MAVLINK_MSG_ID_ATTITUDE, d.MAVLINK_MSG_ID_LOCAL_POSITION_NED):
                self.connection.ask(d.MAV_CMD_SET_MESSAGE_INTERVAL, message, 1e6 / MOTION_RATE)

    def handle(self, message: Any) -> None:
        """Take a message of the autopilot."""
        kind, now = message.get_type(), self.now()
        with self.lock:
            if kind == "HEARTBEAT":
                self.beat, self.mode = now, message.custom_mode
                self.armed = bool(message.base_mode & self.connection.dialect.MAV_MODE_FLAG_SAFETY_ARMED)
            elif kind == "ATTITUDE":
                self.yaw, self.yaw_rate = message.yaw, message.yawspeed
            elif kind == "LOCAL_POSITION_NED":
                self.moved = now
                ahead = message.vx * math.cos(self.yaw) + message.vy * math.sin(self.yaw)
                self.samples = [*self.samples[-99:], (ahead, -self.yaw_rate)]
            elif kind == "SYS_STATUS":
                self.battery = message.voltage_battery / 1e3
            elif kind == "COMMAND_ACK" and message.result not in (0, 5):
                self.report(f"link: the autopilot refuses command {message.command} (result {message.result})")


@link("mavlink", MavlinkDriveSettings)
def open_mavlink(settings: MavlinkDriveSettings, opening: Opening) -> MavlinkDrive:
    connection = MavlinkConnection.open(settings)
    try:
        return MavlinkDrive(connection, settings.arm, opening.report)
    except BaseException:
        connection.close()
        raise
