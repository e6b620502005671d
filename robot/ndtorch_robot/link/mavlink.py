"""The drive link to a rover with an autopilot, over MAVLink: ArduPilot Rover in its mode GUIDED."""

from __future__ import annotations

import contextlib
import math
import os
import threading
import time
from collections.abc import Callable
from typing import Annotated, Any

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

MOTION_INTERVAL_US = 1e6 / 30
"""Time between two messages of motion that the autopilot is asked for."""

GUIDED, VELOCITY_AND_YAW_RATE = 15, 0x5C7
"""Mode of ArduPilot Rover that takes set-points; type mask of one of which velocity and yaw rate alone count."""

SLOW = 0.05
"""Below this speed the curvature is not known from the yaw rate, m/s."""


class MavlinkSettings(Strict):
    """A connection to a vehicle."""

    # udpin:ADDRESS:PORT, udpout:ADDRESS:PORT, tcp:ADDRESS:PORT or a serial port, as of pymavlink
    device: str = "udpin:127.0.0.1:14550"
    baud: Annotated[int, Field(ge=1200, le=4_000_000)] = 921_600  # symbols a second of a serial port
    system_id: Annotated[int, Field(ge=1, le=255)] = 1  # of the vehicle, to which alone it listens


class MavlinkDrive(Drive):
    """A rover whose autopilot takes velocity set-points; a thread reads, anybody sends.

    It obeys while the autopilot is armed, in GUIDED, heard, and the loop sends commands. When one of these ends it
    stands until `resume`. A person arms it and sets its mode: who switches to MANUAL drives.

    Raises:
        InputError: the device cannot be opened; no heartbeat of the system.
    """

    def __init__(
        self, settings: MavlinkSettings, report: Report = print, now: Callable[[], float] = time.monotonic
    ) -> None:
        os.environ.setdefault("MAVLINK20", "1")
        mavutil = need("pymavlink.mavutil", "MAVLink")
        self.dialect = need("pymavlink.dialects.v20.common", "MAVLink")
        self.settings, self.report, self.now, self.begun = settings, report, now, time.monotonic()
        address = {"baud": settings.baud, "source_system": settings.system_id, "source_component": COMPONENT}
        try:
            self.port = mavutil.mavlink_connection(settings.device, **address, dialect="common", autoreconnect=True)
        except (OSError, ValueError, IndexError) as error:
            raise InputError(f"{settings.device}: cannot be opened ({error})") from None
        self.latest: dict[str, tuple[float, Any]] = {}  # the last of each type, and when it came
        self.lock, self.closing, self.heard = threading.RLock(), threading.Event(), threading.Event()
        # Receiving by UDP changes the set of addresses that sending walks; by TCP it may wait for a new connection.
        self.receiving = self.lock if settings.device.startswith("udp") else contextlib.nullcontext()
        self.standing, self.sent, self.commanded, self.asked = True, STAND, -math.inf, -math.inf
        self.fault: str | None = None
        self.thread = threading.Thread(target=self.listen, name="mavlink", daemon=True)
        self.thread.start()
        if not self.heard.wait(GREETING):
            self.close()
            raise InputError(f"{settings.device}: no heartbeat of system {settings.system_id}")

    def send_message(self, name: str, *values: Any) -> bool:
        """Send the message of this name, such as `"heartbeat"`; False where the port is gone."""
        with self.lock:
            try:
                getattr(self.port.mav, f"{name}_send")(*values)
            except OSError:
                return False
        return True

    def age(self, kind: str) -> float:
        """Seconds since the last message of this type; infinite before any."""
        return self.now() - self.latest[kind][0] if kind in self.latest else math.inf

    def listen(self) -> None:
        beaten, d = -math.inf, self.dialect
        while not self.closing.is_set():
            if time.monotonic() - beaten >= HEARTBEAT_EVERY:
                beaten = time.monotonic()
                self.send_message("heartbeat", d.MAV_TYPE_ONBOARD_CONTROLLER, d.MAV_AUTOPILOT_INVALID, 0, 0, 4)
            if self.heard.is_set():
                self.look_after()
            try:
                self.port.select(TICK)
                while (message := self.receive()) is not None:
                    if (message.get_srcSystem(), message.get_srcComponent()) == (self.settings.system_id, AUTOPILOT):
                        self.latest[message.get_type()] = self.now(), message
                        if message.get_type() == "HEARTBEAT":
                            self.heard.set()
            except OSError:  # a serial port is opened anew by pymavlink; the silence is noticed
                self.closing.wait(TICK)

    def receive(self) -> Any:
        with self.receiving:
            return self.port.recv_msg()

    def send(self, command: SafeCommand) -> DriveCommand:
        wanted, now = unseal(command), self.now()
        with self.lock:
            self.commanded = now
            obeys = not self.standing and self.why_not() is None and now - command.time <= OLDEST_COMMAND
            self.sent = wanted if obeys else STAND
            if not self.set_point(self.sent):
                self.sent = STAND
            return self.sent

    def set_point(self, command: DriveCommand) -> bool:
        """x is ahead and yaw rates are clockwise in the frame of the body of MAVLink."""
        boot_ms = int((time.monotonic() - self.begun) * 1e3) & 0xFFFFFFFF
        about = (boot_ms, self.settings.system_id, AUTOPILOT, self.dialect.MAV_FRAME_BODY_NED, VELOCITY_AND_YAW_RATE)
        turn = -command.speed * command.curvature
        values = (0, 0, 0, command.speed, 0, 0, 0, 0, 0, 0, turn)
        return self.send_message("set_position_target_local_ned", *about, *values)

    def stop(self) -> None:
        self.standing = True
        self.set_point(STAND)

    def resume(self) -> bool:
        with self.lock:
            self.fault, self.commanded = self.why_not(), self.now()
            self.standing = self.fault is not None
            return not self.standing

    def why_not(self) -> str | None:
        silent, still = self.age("HEARTBEAT"), self.age("LOCAL_POSITION_NED")
        if silent > HEARTBEAT_PATIENCE:
            return f"lost: no heartbeat of the autopilot for {silent:.1f} s"
        if MOTION_PATIENCE < still < math.inf:
            return f"lost: no motion from the autopilot for {still:.1f} s"
        state = self.telemetry()
        if not state["armed"]:
            return "the autopilot is disarmed"
        return None if state["mode"] == GUIDED else f"the autopilot is in mode {state['mode']}, not GUIDED"

    def trouble(self) -> str | None:
        return self.fault

    def driven(self) -> DriveCommand:
        if not {"LOCAL_POSITION_NED", "ATTITUDE"} <= self.latest.keys():
            return self.sent
        moved, attitude = self.latest["LOCAL_POSITION_NED"][1], self.latest["ATTITUDE"][1]
        speed = moved.vx * math.cos(attitude.yaw) + moved.vy * math.sin(attitude.yaw)
        return DriveCommand(speed, -attitude.yawspeed / speed if abs(speed) > SLOW else 0.0)

    def telemetry(self) -> dict[str, Any]:
        status, beat = self.latest.get("SYS_STATUS"), self.latest["HEARTBEAT"][1]
        volts = 0.0 if status is None else status[1].voltage_battery / 1e3
        armed = bool(beat.base_mode & self.dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        return {"armed": armed, "mode": int(beat.custom_mode), "battery_v": volts, "link": self.fault}

    def close(self) -> None:
        if not self.closing.is_set():
            self.stop()
            self.closing.set()
            self.thread.join(2.0)
            self.port.close()

    def look_after(self) -> None:
        """Stop where the loop is silent or the autopilot does not obey any more; ask for motion where none comes."""
        now, d = self.now(), self.dialect
        with self.lock:
            why = self.why_not()
            if why is None and now - self.commanded > LOOP_PATIENCE:
                why = f"the loop has sent nothing for {now - self.commanded:.2f} s"
            if why is not None and not self.standing:
                self.fault = why
                self.stop()
                self.report(f"link: {why}")
        if self.age("LOCAL_POSITION_NED") > MOTION_PATIENCE and now - self.asked > 1.0:
            self.asked = now
            request = self.settings.system_id, AUTOPILOT, d.MAV_CMD_SET_MESSAGE_INTERVAL, 0
            for message in (d.MAVLINK_MSG_ID_ATTITUDE, d.MAVLINK_MSG_ID_LOCAL_POSITION_NED):
                self.send_message("command_long", *request, message, MOTION_INTERVAL_US, *[0.0] * 5)


@link("mavlink")
def open_mavlink(settings: MavlinkSettings, opening: Opening) -> MavlinkDrive:
    return MavlinkDrive(settings, opening.report)
