"""The drive at the other end of a serial line: two threads, one that listens and one that supervises the loop."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict
from ndtorch_robot.link import SERIAL, Opening, link
from ndtorch_robot.link.link_drive import GONE, HEARTBEAT, LinkDrive
from ndtorch_robot.ports import Report

if TYPE_CHECKING:
    import serial

GREETING = 3.0
"""Seconds to wait for a welcome: a board that is reset by opening its port takes two."""

BACK_OFF = (0.1, 2.0)
"""Shortest and longest pause between attempts to connect anew, s."""

READ_TIMEOUT, WRITE_TIMEOUT = 0.02, 0.05


class SerialSettings(Strict):
    """`[link]` of a car, where `kind` is `"serial"` or not given."""

    device: str  # the port, best by /dev/serial/by-id
    baud: Annotated[int, Field(ge=1200, le=4_000_000)] = 500_000  # symbols a second; the firmware's


class SerialDrive(LinkDrive):
    """A drive over a serial line, with two threads: one listens and reconnects, one sends heartbeats.

    Raises:
        InputError: no such device, no permission, in use, no answer, wrong baud, another protocol version, or
            another board.
    """

    port: serial.Serial | None

    def __init__(self, device: str, baud: int = 500_000, board_name: str | None = None, report: Report = print) -> None:
        self.device, self.baud, self.closing = device, baud, threading.Event()
        super().__init__(open_port(device, baud), time.monotonic, board_name, report)
        works = (self.listen, self.supervise)
        self.threads = [threading.Thread(target=work, name=work.__name__, daemon=True) for work in works]
        for thread in self.threads:
            thread.start()
        try:
            end = time.monotonic() + GREETING
            while not self.welcomed.wait(0.02):
                if self.refusal is not None:
                    raise InputError(f"{device}: {self.refusal}")
                if time.monotonic() > end:
                    count, silence = self.parser.received, "no answer from the board; is the firmware on it?"
                    garbled = f"{count} bytes came but no valid frame; is {baud} baud right?"
                    raise InputError(f"{device}: {garbled if count else silence} (make -C robot/firmware flash)")
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self.stop()
        self.closing.set()
        for thread in self.threads:
            if thread is not threading.current_thread():
                thread.join(2.0)
        self.drop()

    def supervise(self) -> None:
        while not self.closing.wait(HEARTBEAT):
            self.look_after()

    def listen(self) -> None:
        """Read and greet for as long as the port is there, then connect anew, with growing pauses."""
        pause = BACK_OFF[0]
        while not self.closing.is_set():
            why = self.converse()
            if self.closing.is_set():
                break
            self.welcomed.clear()
            self.disarm(f"lost: {why}", stop=False)
            self.drop()
            while self.port is None and not self.closing.wait(pause):
                pause = min(2 * pause, BACK_OFF[1])
                with contextlib.suppress(InputError):
                    port = open_port(self.device, self.baud)
                    pause = BACK_OFF[0] if self.heard is not None else pause
                    with self.line_lock:
                        self.port = port

    def converse(self) -> str:
        """Handle what comes until the line is gone; returns why."""
        opened, self.greeted_at, port = time.monotonic(), -math.inf, self.port
        assert port is not None
        while not self.closing.is_set():
            if not self.welcomed.is_set():
                if time.monotonic() - max(opened, self.heard_at) > 2 * GREETING:
                    return "no answer from the board"
                self.greet()
            try:
                self.handle(port.read(port.in_waiting or 1))
            except GONE as error:
                return f"the serial port is gone ({error})"
        return "closed"


def open_port(device: str, baud: int) -> serial.Serial:
    import serial

    try:
        return serial.Serial(device, baud, timeout=READ_TIMEOUT, write_timeout=WRITE_TIMEOUT, exclusive=True)
    except (OSError, ValueError) as error:  # of which SerialException is one
        hint = "is the board plugged in, the port free, and this user in the group dialout?"
        raise InputError(f"{device}: cannot be opened ({error}); {hint}") from None


@link(SERIAL)
def open_serial(settings: SerialSettings, opening: Opening) -> SerialDrive:
    return SerialDrive(settings.device, settings.baud, opening.board_name, opening.report)
