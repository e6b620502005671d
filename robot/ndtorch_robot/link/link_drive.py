"""The protocol with the board: what is sent, and what follows from its answers. No threads, any clock."""

from __future__ import annotations

import contextlib
import math
import termios
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from ndtorch_robot.link.messages import (
    VERSION,
    WELCOME_BODY,
    WIDEST,
    LinkFault,
    LinkFrame,
    Parser,
    Telemetry,
    Type,
    command_body,
    encode_frame,
    read_telemetry,
)
from ndtorch_robot.ports import STAND, Drive, DriveCommand, Report, SafeCommand, unseal

GONE = (OSError, termios.error, TypeError)
"""What pyserial raises when the cable is pulled; TypeError when the port was closed in between."""

HEARTBEAT, HELLO_EVERY = 0.03, 0.1
"""Seconds between heartbeats, without which the board stops after 0.15 s, and between greetings."""

LOOP_PATIENCE, LINK_PATIENCE = 0.12, 0.12
"""Seconds without a command after which the loop counts as dead, and without telemetry after which the link is lost."""

OLDEST_COMMAND, ARMING = 0.1, 0.1
"""Age at which a command is no longer sent, s, and time in which the board may still say that it is not armed."""

NOISE_LIMIT, FORGIVE = 4, 0.2
"""More refused frames than this, less one forgiven every 0.2 s, are a bad line."""


class Port(Protocol):
    """What bytes are written to; raises one of `GONE` when it cannot."""

    def write(self, data: bytes, /) -> Any: ...

    def close(self) -> None: ...


class LinkDrive(Drive):
    """A drive at the other end of a line.

    After opening, after any fault and after any reconnection the car is stopped until `resume`. Its owner calls
    `handle` with the bytes from the board, `greet` often while the board is not known, and `look_after` every
    `HEARTBEAT` seconds: heartbeats go out only while the loop sends commands, and without heartbeats, or without
    commands, the board stops by itself. `heard` is the latest telemetry, `refusal` why the board is of no use.
    """

    def __init__(
        self, port: Port, now: Callable[[], float], board_name: str | None = None, report: Report = print
    ) -> None:
        self.port: Port | None = port
        self.now, self.board_name, self.report = now, board_name, report
        self.lock, self.line_lock, self.welcomed = threading.Lock(), threading.Lock(), threading.Event()
        self.parser, self.standing, self.armed = Parser(), True, False
        self.fault: str | None = None
        self.refusal: str | None = None
        self.heard: Telemetry | None = None
        self.heard_at = self.armed_at = self.commanded_at = 0.0
        self.greeted_at = -math.inf
        self.received = self.sequence = 0
        self.refused, self.noise, self.noise_at = 0, 0.0, 0.0
        self.beats: dict[int, float] = {}
        self.trips: deque[float] = deque(maxlen=100_000)
        self.applied: deque[DriveCommand] = deque(maxlen=30)
        self.last_applied = STAND

    def send(self, command: SafeCommand) -> DriveCommand:
        """Drive like this from now on; returns what was sent, rounded as the line does, or a stop when not armed."""
        wanted, now = unseal(command), self.now()
        self.commanded_at = now
        if not self.armed or now - command.time > OLDEST_COMMAND:
            return STAND
        sent = DriveCommand(*(round(min(max(value, -WIDEST), WIDEST), 3) for value in wanted))
        return sent if self.send_message(Type.COMMAND, command_body(sent)) else STAND

    def stop(self) -> None:
        with self.lock:
            self.standing, self.armed = True, False
        self.send_message(Type.STOP)

    def resume(self) -> bool:
        if not self.welcomed.is_set():
            return False
        with self.lock:
            self.fault, self.standing, self.armed = None, False, False
            self.armed_at = self.commanded_at = self.now()
            self.noise = 0.0
        return self.send_message(Type.ARM)

    def trouble(self) -> str | None:
        return self.fault

    def driven(self) -> DriveCommand:
        applied = [self.applied.popleft() for _ in range(len(self.applied))]
        if not applied:
            return self.last_applied if self.welcomed.is_set() else STAND
        return DriveCommand(*(sum(values) / len(applied) for values in zip(*applied, strict=True)))

    def telemetry(self) -> dict[str, Any]:
        return ({} if self.heard is None else self.heard.values()) | {"link": self.trouble()}

    def round_trips(self) -> Sequence[float]:
        return self.trips

    def send_message(self, kind: Type, body: bytes = b"") -> bool:
        """Send one message, from any thread; False when the line did not take it."""
        with self.line_lock:
            if self.port is None:
                return False
            self.sequence = self.sequence + 1 & 0xFFFF
            data = encode_frame(LinkFrame(VERSION, kind, self.sequence, body))
            if kind == Type.HELLO:
                data = b"\0" + data  # ends whatever the board has half of
            if kind == Type.HEARTBEAT:
                self.beats[self.sequence] = self.now()
                if len(self.beats) > 64:
                    del self.beats[next(iter(self.beats))]
            try:
                self.port.write(data)
            except GONE:  # the reading thread notices it too, and reports it
                return False
        return True

    def drop(self) -> None:
        with self.line_lock:
            port, self.port = self.port, None
        if port is not None:
            with contextlib.suppress(*GONE):
                port.close()

    def look_after(self) -> None:
        """A heartbeat while the loop lives; notices a silent loop and a silent board."""
        now = self.now()
        if not self.welcomed.is_set():
            return
        if not self.standing and now - self.commanded_at > LOOP_PATIENCE:
            self.disarm(f"the loop has sent nothing for {now - self.commanded_at:.2f} s")
        if now - self.heard_at > LINK_PATIENCE:
            self.welcomed.clear()
            self.disarm(f"lost: no valid telemetry for {now - self.heard_at:.2f} s")
            return
        self.send_message(Type.HEARTBEAT)

    def greet(self) -> None:
        """Say hello now and then, until the board has answered."""
        now = self.now()
        if not self.welcomed.is_set() and now - self.greeted_at > HELLO_EVERY:
            self.greeted_at = now
            self.send_message(Type.HELLO)

    def handle(self, data: bytes) -> None:
        now, parser = self.now(), self.parser
        frames = parser.feed(data)
        if parser.other_version is not None:
            versions = f"version {parser.other_version} of the protocol, this program {VERSION}"
            self.refusal = f"the board speaks {versions}: flash it with make -C robot/firmware flash"
            parser.other_version = None
            self.welcomed.clear()
            self.disarm(self.refusal)
        for frame in frames:
            if frame.type == Type.WELCOME:
                self.on_welcome(frame)
            elif frame.type == Type.TELEMETRY and self.welcomed.is_set():
                self.on_telemetry(frame)
        self.noise = max(0.0, self.noise - (now - self.noise_at) / FORGIVE) + parser.refused - self.refused
        self.noise_at, self.refused = now, parser.refused
        if self.noise > NOISE_LIMIT and not self.standing:
            self.disarm("bad line: many frames from the board are refused")

    def on_welcome(self, frame: LinkFrame) -> None:
        name = bytes(WELCOME_BODY.unpack(frame.body)[1]).rstrip(b"\0 ").decode("ascii", "replace")
        if self.board_name is not None and name != self.board_name:
            self.refusal = f"the board is that of the robot {name!r}, the configuration is for {self.board_name!r}"
            return
        again = self.heard is not None and not self.welcomed.is_set()
        self.refusal, self.noise, self.heard_at, self.received = None, 0.0, self.now(), frame.sequence
        self.last_applied = STAND  # what it applied before the line was lost is long over
        self.welcomed.set()
        if again:
            self.report("link: connected again; the car stands until it is resumed")

    def on_telemetry(self, frame: LinkFrame) -> None:
        if not 0 < (frame.sequence - self.received) & 0xFFFF < 0x8000:  # repeated, or older than the last
            self.parser.refused += 1
            return
        now, before, telemetry = self.now(), self.heard, read_telemetry(frame.body)
        self.heard, self.received, self.heard_at = telemetry, frame.sequence, now
        self.last_applied = telemetry.applied
        self.applied.append(telemetry.applied)
        sent = self.beats.pop(telemetry.echo, None)
        if sent is not None:
            self.trips.append(now - sent)
        new = telemetry.faults & ~(before.faults if before is not None else LinkFault(0))
        if LinkFault.BATTERY in new:
            self.report(f"link: battery low, {telemetry.battery_v:.1f} V")
        if LinkFault.WATCHDOG in new:
            self.report("link: the board was reset by its watchdog timer")
        if self.standing:
            return
        if telemetry.armed:
            self.armed = True
        elif self.armed and now - self.armed_at > ARMING:
            self.disarm(f"the board has stopped: {', '.join(telemetry.words()) or 'it was not armed'}", stop=False)
        elif now - self.armed_at > ARMING:
            self.disarm("the board does not resume")

    def disarm(self, why: str, stop: bool = True) -> None:
        """Hold the car until `resume`; `stop`: the board does not know yet."""
        with self.lock:
            news = self.fault is None
            self.fault = self.fault or why
            self.armed, self.standing = False, True
        if stop:
            self.send_message(Type.STOP)
        if news:
            self.report(f"link: {why}")
