"""The drive at the other end of a serial line: two threads, one that listens and one that supervises the loop."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.toml import Strict
from ndtorch_robot.link.hearing import Hearing, news
from ndtorch_robot.link.line import GONE, SerialLine
from ndtorch_robot.link.messages import Frame, Telemetry, Type, command_body, read_welcome, sendable
from ndtorch_robot.link.port import read_some
from ndtorch_robot.link.registry import SERIAL, Opening, link
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
GREETING = 3.0
"""Seconds to wait for a welcome: a board that is reset by opening its port takes two."""

BACK_OFF = (0.1, 2.0)
"""Shortest and longest pause between attempts to connect anew, s."""

NOT_YET = "not yet told to drive"


class SerialSettings(Strict):
    """`[link]` of a car, where `kind` is `"serial"` or not given.

    Args:
        device: the port, best by `/dev/serial/by-id`.
        baud: symbols a second; the firmware's.
    """

    device: str
    baud: Annotated[int, Field(ge=1200, le=4_000_000)] = 500_000


class SerialDrive(Drive):
    """A drive over a serial line.

    After opening, after any fault and after any reconnection the car stands until `resume`. The listening thread
    reads, greets the board and reconnects. The supervising thread sends heartbeats, but only while the loop sends
    commands: without heartbeats, or without commands, the board stops by itself.

    Args:
        device: the port, best by `/dev/serial/by-id`.
        baud: symbols a second.
        robot: name the board must have; any by default.
        report: told once of everything that happens, one line each.
        greeting: seconds to wait for the first welcome.

    Raises:
        InputError: no such device, no permission, in use, no answer, wrong baud, another protocol version, or
            another robot.
    """

    def __init__(
        self,
        device: str,
        baud: int = 500_000,
        robot: str | None = None,
        report: Report = print,
        greeting: float = GREETING,
    ) -> None:
        self.device, self.baud, self.robot, self.report, self.greeting = device, baud, robot, report, greeting
        self.lock = threading.Lock()
        self.welcomed = threading.Event()
        self.closing = threading.Event()
        self.hearing = Hearing()
        self.armed = False
        self.asked_to_arm = -1.0
        self.standing = True
        self.fault: str | None = NOT_YET
        self.refusal: str | None = None
        self.last_command = 0.0
        self.line = SerialLine(device, baud)
        works = (self.listen, self.supervise)
        self.threads = [threading.Thread(target=work, name=work.__name__, daemon=True) for work in works]
        for thread in self.threads:
            thread.start()
        try:
            self.await_welcome()
        except BaseException:
            self.close()
            raise

    def await_welcome(self) -> None:
        """Wait until the board has answered; raises `InputError` with the reason when it does not."""
        end = time.monotonic() + self.greeting
        while not self.welcomed.wait(0.02):
            if self.refusal is not None:
                raise InputError(f"{self.device}: {self.refusal}")
            if time.monotonic() > end:
                raise InputError(f"{self.device}: {self.hearing.silence(self.baud)}")

    @property
    def heard(self) -> Telemetry | None:
        """The latest telemetry."""
        return self.hearing.telemetry

    # What the loop calls.

    def send(self, command: SafeCommand) -> DriveCommand:
        """Drive like this from now on; returns what was sent, rounded as the line does, or standing when not armed.

        Raises:
            TypeError: a command that did not come through the safety layer.
        """
        wanted = unseal(command)
        now = time.monotonic()
        self.last_command = now
        if not self.armed or now - command.time > OLDEST_COMMAND:
            return STAND
        sent = sendable(wanted)
        return sent if self.line.write(Type.COMMAND, command_body(sent)) else STAND

    def stop(self) -> None:
        """Tell the board to stand; it does so at its next pulse, within 20 ms."""
        with self.lock:
            self.standing, self.armed = True, False
        self.line.write(Type.STOP)

    def resume(self) -> bool:
        """Ask the board to obey again; `trouble` is None from now on unless it does not. False without a link."""
        if not self.welcomed.is_set():
            return False
        now = time.monotonic()
        with self.lock:
            self.fault, self.standing, self.armed = None, False, False
            self.asked_to_arm = self.last_command = now
            self.hearing.noise.count = 0
        return self.line.write(Type.ARM)

    def trouble(self) -> str | None:
        """Why the car stands whatever is sent, other than that it was told to stop."""
        return self.fault

    def driven(self) -> DriveCommand:
        """Mean of the speeds and curvatures that the board has applied since this was last asked."""
        driven = self.hearing.driven()
        if driven is not None:
            return driven
        return self.heard.applied if self.heard is not None and self.welcomed.is_set() else STAND

    def telemetry(self) -> dict[str, Any]:
        """What the board says of itself; `link` is why it cannot be commanded, or None."""
        return ({} if self.heard is None else self.heard.values()) | {"link": self.trouble()}

    def round_trips(self) -> Sequence[float]:
        """From a heartbeat to its echo, s."""
        return self.line.trips

    def close(self) -> None:
        """Stop, end both threads and give the port back."""
        self.stop()
        self.closing.set()
        for thread in self.threads:
            if thread is not threading.current_thread():
                thread.join(2.0)
        self.line.drop()

    def disarm(self, why: str, tell: bool) -> None:
        """The car stands from now on."""
        with self.lock:
            news = self.fault in (None, NOT_YET)
            self.armed, self.standing = False, True
            if news:
                self.fault = why
        if tell:
            self.line.write(Type.STOP)
        if news:
            self.report(f"link: {why}")

    # The supervising thread.

    def supervise(self) -> None:
        """Heartbeats while the loop lives; notices a silent loop, a silent board and a bad line."""
        while not self.closing.wait(HEARTBEAT):
            now = time.monotonic()
            if not self.welcomed.is_set():
                continue
            if not self.standing and now - self.last_command > LOOP_PATIENCE:
                self.disarm(f"the loop has sent nothing for {now - self.last_command:.2f} s", tell=True)
            if now - self.hearing.last > LINK_PATIENCE:
                self.welcomed.clear()
                self.disarm(f"lost: no valid telemetry for {now - self.hearing.last:.2f} s", tell=True)
                continue
            self.line.write(Type.HEARTBEAT)

    # The listening thread.

    def listen(self) -> None:
        """Read and greet for as long as the port is there, then connect anew, with growing pauses."""
        pause = BACK_OFF[0]
        while not self.closing.is_set():
            why = self.converse()
            if self.closing.is_set():
                break
            self.welcomed.clear()
            self.disarm(f"lost: {why}", tell=False)
            self.line.drop()
            while not self.closing.wait(pause):
                pause = min(2 * pause, BACK_OFF[1])
                if not self.line.reopen():
                    continue
                pause = BACK_OFF[0] if self.heard is not None else pause
                break

    def converse(self) -> str:
        """Handle what comes until the line is gone; returns why."""
        greeted = 0.0
        opened = time.monotonic()
        port = self.line.port
        assert port is not None
        while not self.closing.is_set():
            now = time.monotonic()
            if not self.welcomed.is_set():
                if now - max(opened, self.hearing.last) > 2 * GREETING:
                    return "no answer from the board"
                if now - greeted > HELLO_EVERY:
                    greeted = now
                    self.hearing.begin()
                    self.line.write(Type.HELLO)
            try:
                data = read_some(port)
            except GONE as error:
                return f"the serial port is gone ({error})"
            self.handle(data)
        return "closed"

    def handle(self, data: bytes) -> None:
        """Bytes from the board."""
        frames = self.hearing.parser.feed(data)
        if (other := self.hearing.other_version()) is not None:
            self.refusal = other
            self.welcomed.clear()
            self.disarm(self.refusal, tell=True)
        for frame in frames:
            if frame.type == Type.WELCOME:
                self.on_welcome(frame)
            elif frame.type == Type.TELEMETRY and self.welcomed.is_set():
                self.on_telemetry(frame)
        if self.hearing.bad(time.monotonic()) and not self.standing:
            self.disarm("bad line: many frames from the board are refused", tell=True)

    def on_welcome(self, frame: Frame) -> None:
        """The board has answered a hello."""
        welcome = read_welcome(frame.body)
        if self.robot is not None and welcome.robot != self.robot:
            self.refusal = f"the board is that of the robot {welcome.robot!r}, the configuration is for {self.robot!r}"
            return
        again = self.heard is not None and not self.welcomed.is_set()
        self.refusal = None
        self.hearing.welcome(frame, time.monotonic())
        self.welcomed.set()
        if again:
            self.report("link: connected again; the car stands until it is told to resume")

    def on_telemetry(self, frame: Frame) -> None:
        """What the board does."""
        now, before = time.monotonic(), self.heard
        telemetry = self.hearing.take(frame, now)
        if telemetry is None:
            return
        self.line.echoed(telemetry.echo, now)
        for line in news(before, telemetry):
            self.report(f"link: {line}")
        if self.standing:
            return
        if telemetry.armed:
            self.armed = True
        elif now - self.asked_to_arm <= 0.1:
            return  # it may have said that before it was asked
        elif self.armed:
            self.disarm(f"the board stands: {telemetry.why()}", tell=False)
        else:
            self.disarm("the board does not resume", tell=True)


@link(SERIAL, SerialSettings)
def open_serial(settings: SerialSettings, opening: Opening) -> SerialDrive:
    """Open the port and greet the board."""
    return SerialDrive(settings.device, settings.baud, opening.robot, opening.report)
