"""The protocol with the board: what is sent, and what follows from its answers. No threads, any clock."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

from ndtorch_robot.link.line import Line
from ndtorch_robot.link.messages import Frame, Telemetry, Type, command_body, quantised, read_welcome
from ndtorch_robot.link.receiver import Receiver, new_events
from ndtorch_robot.ports import STAND, Drive, DriveCommand, Report, SafeCommand, unseal

HEARTBEAT = 0.03
"""Seconds between heartbeats; the board stops after 0.15 s without."""

LOOP_PATIENCE = 0.12
"""Seconds without a command after which the loop counts as dead: no more heartbeats, and a stop."""

LINK_PATIENCE = 0.12
"""Seconds without valid telemetry after which the link counts as lost."""

OLDEST_COMMAND = 0.1
"""Age at which a command is no longer sent, s."""

HELLO_EVERY = 0.1

NOT_YET = "not yet told to drive"


class LinkDrive(Drive):
    """A drive at the other end of a line.

    After opening, after any fault and after any reconnection the car is stopped until `resume`. Its owner calls
    `handle` with the bytes from the board, `greet` often while the board is not known, and `look_after` every
    `HEARTBEAT` seconds: heartbeats go out only while the loop sends commands, and without heartbeats, or without
    commands, the board stops by itself.

    Args:
        line: where frames are written to.
        now: the time, s.
        robot: name the board must have; any by default.
        report: called once for every event, with one line.
    """

    def __init__(self, line: Line, now: Callable[[], float], robot: str | None = None, report: Report = print) -> None:
        self.line, self.now, self.robot, self.report = line, now, robot, report
        self.lock = threading.Lock()
        self.welcomed = threading.Event()
        self.receiver = Receiver()
        self.armed = False
        self.asked_to_arm = -1.0
        self.standing = True
        self.fault: str | None = NOT_YET
        self.refusal: str | None = None
        self.last_command = 0.0
        self.greeted = float("-inf")

    @property
    def heard(self) -> Telemetry | None:
        return self.receiver.telemetry

    # What the loop calls.

    def send(self, command: SafeCommand) -> DriveCommand:
        """Drive like this from now on; returns what was sent, rounded as the line does, or a stop when not armed.

        Raises:
            TypeError: a command that did not come through the safety layer.
        """
        wanted = unseal(command)
        now = self.now()
        self.last_command = now
        if not self.armed or now - command.time > OLDEST_COMMAND:
            return STAND
        sent = quantised(wanted)
        return sent if self.line.write(Type.COMMAND, command_body(sent)) else STAND

    def stop(self) -> None:
        """Stop the wheels; the board does so at its next pulse, within 20 ms."""
        with self.lock:
            self.standing, self.armed = True, False
        self.line.write(Type.STOP)

    def resume(self) -> bool:
        """Ask the board to obey again; `trouble` is None from now on unless it does not. False without a link."""
        if not self.welcomed.is_set():
            return False
        now = self.now()
        with self.lock:
            self.fault, self.standing, self.armed = None, False, False
            self.asked_to_arm = self.last_command = now
            self.receiver.quality.count = 0
        return self.line.write(Type.ARM)

    def trouble(self) -> str | None:
        """Why the car does not obey, other than after `stop`; None when all is well."""
        return self.fault

    def driven(self) -> DriveCommand:
        """Mean of the speeds and curvatures that the board has applied since this was last asked."""
        driven = self.receiver.driven()
        if driven is not None:
            return driven
        return self.receiver.applied if self.welcomed.is_set() else STAND

    def telemetry(self) -> dict[str, Any]:
        """The telemetry of the board; `link` is why it cannot be commanded, or None."""
        return ({} if self.heard is None else self.heard.values()) | {"link": self.trouble()}

    def round_trips(self) -> Sequence[float]:
        """From a heartbeat to its echo, s."""
        return self.line.trips

    def disarm(self, why: str, tell: bool) -> None:
        """Stop the car until `resume`."""
        with self.lock:
            news = self.fault in (None, NOT_YET)
            self.armed, self.standing = False, True
            if news:
                self.fault = why
        if tell:
            self.line.write(Type.STOP)
        if news:
            self.report(f"link: {why}")

    # What the owner of the link calls.

    def look_after(self) -> None:
        """A heartbeat while the loop lives; notices a silent loop and a silent board."""
        now = self.now()
        if not self.welcomed.is_set():
            return
        if not self.standing and now - self.last_command > LOOP_PATIENCE:
            self.disarm(f"the loop has sent nothing for {now - self.last_command:.2f} s", tell=True)
        if now - self.receiver.last > LINK_PATIENCE:
            self.welcomed.clear()
            self.disarm(f"lost: no valid telemetry for {now - self.receiver.last:.2f} s", tell=True)
            return
        self.line.write(Type.HEARTBEAT)

    def greet(self) -> None:
        """Say hello now and then, until the board has answered."""
        now = self.now()
        if not self.welcomed.is_set() and now - self.greeted > HELLO_EVERY:
            self.greeted = now
            self.receiver.begin()
            self.line.write(Type.HELLO)

    def handle(self, data: bytes) -> None:
        frames = self.receiver.parser.feed(data)
        if (other := self.receiver.other_version()) is not None:
            self.refusal = other
            self.welcomed.clear()
            self.disarm(self.refusal, tell=True)
        for frame in frames:
            if frame.type == Type.WELCOME:
                self.on_welcome(frame)
            elif frame.type == Type.TELEMETRY and self.welcomed.is_set():
                self.on_telemetry(frame)
        if self.receiver.bad(self.now()) and not self.standing:
            self.disarm("bad line: many frames from the board are refused", tell=True)

    def on_welcome(self, frame: Frame) -> None:
        welcome = read_welcome(frame.body)
        if self.robot is not None and welcome.robot != self.robot:
            self.refusal = f"the board is that of the robot {welcome.robot!r}, the configuration is for {self.robot!r}"
            return
        again = self.heard is not None and not self.welcomed.is_set()
        self.refusal = None
        self.receiver.welcome(frame, self.now())
        self.welcomed.set()
        if again:
            self.report("link: connected again; the car stands until it is told to resume")

    def on_telemetry(self, frame: Frame) -> None:
        now, before = self.now(), self.heard
        telemetry = self.receiver.take(frame, now)
        if telemetry is None:
            return
        self.line.echoed(telemetry.echo, now)
        for line in new_events(before, telemetry):
            self.report(f"link: {line}")
        if self.standing:
            return
        if telemetry.armed:
            self.armed = True
        elif now - self.asked_to_arm <= 0.1:
            return  # it may have been sent before the request
        elif self.armed:
            self.disarm(f"the board has stopped: {telemetry.why()}", tell=False)
        else:
            self.disarm("the board does not resume", tell=True)
