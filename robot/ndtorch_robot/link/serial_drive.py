"""The drive at the other end of a serial line: two threads, one that listens and one that supervises the loop."""

from __future__ import annotations

import threading
import time
from typing import Annotated

from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict
from ndtorch_robot.link.line import GONE, SerialLine, read_some
from ndtorch_robot.link.link_drive import HEARTBEAT, LinkDrive
from ndtorch_robot.link.registry import SERIAL, Opening, link
from ndtorch_robot.ports import Report

GREETING = 3.0
"""Seconds to wait for a welcome: a board that is reset by opening its port takes two."""

BACK_OFF = (0.1, 2.0)
"""Shortest and longest pause between attempts to connect anew, s."""


class SerialSettings(Strict):
    """`[link]` of a car, where `kind` is `"serial"` or not given.

    Args:
        device: the port, best by `/dev/serial/by-id`.
        baud: symbols a second; the firmware's.
    """

    device: str
    baud: Annotated[int, Field(ge=1200, le=4_000_000)] = 500_000


class SerialDrive(LinkDrive):
    """A drive over a serial line.

    The listening thread reads, greets the board and reconnects. The supervising thread sends heartbeats.

    Args:
        device: the port, best by `/dev/serial/by-id`.
        baud: symbols a second.
        robot: name the board must have; any by default.
        report: called once for every event, with one line.
        greeting: seconds to wait for the first welcome.

    Raises:
        InputError: no such device, no permission, in use, no answer, wrong baud, another protocol version, or
            another robot.
    """

    line: SerialLine

    def __init__(
        self,
        device: str,
        baud: int = 500_000,
        robot: str | None = None,
        report: Report = print,
        greeting: float = GREETING,
    ) -> None:
        self.device, self.baud, self.greeting = device, baud, greeting
        self.closing = threading.Event()
        super().__init__(SerialLine(device, baud), time.monotonic, robot, report)
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
                raise InputError(f"{self.device}: {self.receiver.silence(self.baud)}")

    def close(self) -> None:
        self.stop()
        self.closing.set()
        for thread in self.threads:
            if thread is not threading.current_thread():
                thread.join(2.0)
        self.line.drop()

    # The supervising thread.

    def supervise(self) -> None:
        while not self.closing.wait(HEARTBEAT):
            self.look_after()

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
        opened = time.monotonic()
        self.greeted = float("-inf")
        port = self.line.port
        assert port is not None
        while not self.closing.is_set():
            now = time.monotonic()
            if not self.welcomed.is_set():
                if now - max(opened, self.receiver.last) > 2 * GREETING:
                    return "no answer from the board"
                self.greet()
            try:
                data = read_some(port)
            except GONE as error:
                return f"the serial port is gone ({error})"
            self.handle(data)
        return "closed"


@link(SERIAL, SerialSettings)
def open_serial(settings: SerialSettings, opening: Opening) -> SerialDrive:
    return SerialDrive(settings.device, settings.baud, opening.board_name, opening.report)
