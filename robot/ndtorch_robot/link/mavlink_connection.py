"""A MAVLink connection to one vehicle, which a drive link and a bridge share: one thread reads, anybody sends."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.utils.packages import need
from ndtorch.utils.toml import Strict

COMPONENT = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER: what we are, in the system of the vehicle."""

AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""

HEARTBEAT_EVERY = 1.0
"""Seconds between our heartbeats."""

GREETING = 5.0
"""Seconds to wait for the first heartbeat of the vehicle."""

TICK = 0.02
"""Seconds after which the reading thread looks after its listeners, whether something has come or not."""


class MavlinkSettings(Strict):
    """A connection to a vehicle.

    Args:
        device: `udpin:ADDRESS:PORT`, `udpout:ADDRESS:PORT`, `tcp:ADDRESS:PORT` or a serial port, as of pymavlink.
        baud: symbols a second of a serial port.
        system_id: of the vehicle; what other systems send is not listened to.
    """

    device: str
    baud: Annotated[int, Field(ge=1200, le=4_000_000)] = 921_600
    system_id: Annotated[int, Field(ge=1, le=255)] = 1


def mavlink_dialect() -> Any:
    """The messages of MAVLink 2; raises `InputError` where pymavlink is not installed."""
    os.environ.setdefault("MAVLINK20", "1")
    need("pymavlink", "MAVLink")
    return need("pymavlink.dialects.v20.common", "MAVLink")


class MavlinkConnection:
    """A connection, with a thread that reads.

    Only messages of the autopilot of the system `system_id` reach the listeners, or those that are sent to us.

    Attributes:
        dialect: the module with the messages and constants.
        heartbeat: the last one of the autopilot.
        others: systems that were heard and are not listened to.
    """

    open_ones: ClassVar[dict[str, MavlinkConnection]] = {}

    def __init__(self, settings: MavlinkSettings) -> None:
        self.dialect = mavlink_dialect()
        self.settings, self.users = settings, 0
        mavutil = need("pymavlink.mavutil", "MAVLink")
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
        self.begun, self.others = time.monotonic(), set[int]()
        self.lock, self.closing, self.heard = threading.Lock(), threading.Event(), threading.Event()
        self.listeners: list[Callable[[Any], None]] = []
        self.ticks: list[Callable[[], None]] = []
        self.beaten, self.heartbeat = float("-inf"), None
        self.thread = threading.Thread(target=self.listen, name="mavlink", daemon=True)
        self.thread.start()

    @classmethod
    def open(cls, settings: MavlinkSettings) -> MavlinkConnection:
        """The connection to that device, new or shared; each `open` wants a `close`."""
        found = cls.open_ones.get(settings.device)
        if found is None:
            found = cls.open_ones[settings.device] = cls(settings)
        found.users += 1
        return found

    def close(self) -> None:
        """Give it back; the last user closes it."""
        self.users -= 1
        if self.users or self.closing.is_set():
            return
        self.open_ones.pop(self.settings.device, None)
        self.closing.set()
        if self.thread is not threading.current_thread():
            self.thread.join(2.0)
        self.port.close()

    def await_vehicle(self) -> Any:
        """Its heartbeat; raises `InputError` where none comes."""
        if not self.heard.wait(GREETING):
            heard = f"; heard systems {', '.join(map(str, sorted(self.others)))}" if self.others else ""
            raise InputError(f"{self.settings.device}: no heartbeat of system {self.settings.system_id}{heard}")
        return self.heartbeat

    def boot_ms(self) -> int:
        """Time since the connection was opened, ms, as messages carry it."""
        return int((time.monotonic() - self.begun) * 1e3) & 0xFFFFFFFF

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

    # The reading thread.

    def listen(self) -> None:
        while not self.closing.is_set():
            now = time.monotonic()
            if now - self.beaten >= HEARTBEAT_EVERY:
                self.beaten, d = now, self.dialect
                self.send("heartbeat", d.MAV_TYPE_ONBOARD_CONTROLLER, d.MAV_AUTOPILOT_INVALID, 0, 0, 4)
            for tick in self.ticks:
                tick()
            try:
                self.port.select(TICK)
                while (message := self.port.recv_msg()) is not None:
                    self.dispatch(message)
            except OSError:  # a serial port is opened anew by pymavlink; the silence is noticed by the link
                self.closing.wait(TICK)

    def dispatch(self, message: Any) -> None:
        system, kind = message.get_srcSystem(), message.get_type()
        if kind == "BAD_DATA":
            return
        us = getattr(message, "target_component", None) == COMPONENT
        ours = system == self.settings.system_id
        if not ours and kind == "HEARTBEAT":
            self.others.add(system)
        autopilot = ours and message.get_srcComponent() == AUTOPILOT
        if not (autopilot or (us and getattr(message, "target_system", None) == self.settings.system_id)):
            return
        for listener in list(self.listeners):
            with contextlib.suppress(AttributeError):  # of a message that another dialect has under this name
                listener(message)
        if autopilot and kind == "HEARTBEAT":
            self.heartbeat = message
            self.heard.set()


def shared_settings(values: Mapping[str, Any], link: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of a bridge, with those of a link of the same kind where they are not given."""
    common = {key: link[key] for key in MavlinkSettings.model_fields if link.get("kind") == "mavlink" and key in link}
    return {**common, **values}
