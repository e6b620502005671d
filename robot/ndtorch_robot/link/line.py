"""A serial line that frames are written to, and what is known of how good it is."""

from __future__ import annotations

import contextlib
import errno
import grp
import os
import select
import termios
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from ndtorch.errors import InputError
from ndtorch_robot.link.messages import VERSION, Frame, Type, encode_frame

if TYPE_CHECKING:
    import serial

GONE = (OSError, termios.error, TypeError)
"""What pyserial raises when the cable is pulled; TypeError when the port was closed in between."""

WRITE_TIMEOUT = 0.05
READ_TIMEOUT = 0.02

NOISE_LIMIT, FORGIVE = 4, 0.2
"""So many refused frames, less one forgiven every 0.2 s, and the line counts as bad."""


class Port(Protocol):
    """What bytes are written to."""

    def write(self, data: bytes, /) -> Any:
        """All of them; raises one of `GONE` when it cannot."""
        ...

    def close(self) -> None: ...


class Line:
    """Writes frames with sequence numbers, from any thread, and times the echoes of heartbeats.

    Args:
        port: where to.
        now: the time, s.

    Attributes:
        port: the open port; None while it is gone.
        trips: seconds from each heartbeat to its echo, the newest last.
    """

    def __init__(self, port: Port, now: Callable[[], float]) -> None:
        self.now = now
        self.lock = threading.Lock()
        self.port: Port | None = port
        self.sequence = 0
        self.beats: dict[int, float] = {}
        self.trips: deque[float] = deque(maxlen=100_000)

    def write(self, kind: Type, body: bytes = b"") -> bool:
        """Send one message; False when the line did not take it."""
        with self.lock:
            port = self.port
            if port is None:
                return False
            self.sequence = self.sequence + 1 & 0xFFFF
            data = encode_frame(Frame(VERSION, kind, self.sequence, body))
            if kind == Type.HELLO:
                data = b"\0" + data  # ends whatever the board has half of
            if kind == Type.HEARTBEAT:
                self.beats[self.sequence] = self.now()
                if len(self.beats) > 64:
                    del self.beats[next(iter(self.beats))]
            try:
                port.write(data)
            except GONE:  # the reading thread sees it too, and reports it
                return False
        return True

    def echoed(self, sequence: int, now: float) -> None:
        sent = self.beats.pop(sequence, None)
        if sent is not None:
            self.trips.append(now - sent)

    def drop(self) -> None:
        with self.lock:
            port, self.port = self.port, None
        if port is not None:
            with contextlib.suppress(*GONE):
                port.close()


class SerialLine(Line):
    """A line over a serial port.

    Raises:
        InputError: no such device, no permission, or in use.
    """

    port: serial.Serial | None

    def __init__(self, device: str, baud: int) -> None:
        self.device, self.baud = device, baud
        super().__init__(open_port(device, baud), time.monotonic)

    def reopen(self) -> bool:
        """Open the port anew; False when it is not there."""
        try:
            port = open_port(self.device, self.baud)
        except InputError:
            return False
        with self.lock:
            self.port = port
        return True


class LinkQuality:
    """Counts refused frames: after too many in a short time nothing that arrives can be trusted."""

    def __init__(self) -> None:
        self.count, self.refused, self.forgiven = 0, 0, 0.0

    def bad(self, refused: int, now: float) -> bool:
        """Whether so many refused frames are too much now, s."""
        self.count += refused - self.refused
        self.refused = refused
        while self.count and now - self.forgiven > FORGIVE:
            self.count -= 1
            self.forgiven = max(self.forgiven + FORGIVE, now - FORGIVE)
        return self.count >= NOISE_LIMIT


def open_port(device: str, baud: int) -> serial.Serial:
    """Open a serial port for this program alone."""
    import serial

    try:
        return serial.Serial(device, baud, timeout=READ_TIMEOUT, write_timeout=WRITE_TIMEOUT, exclusive=True)
    except serial.SerialException as error:
        raise InputError(f"{device}: {reason(device, error.errno, str(error))}") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{device}: is no serial port ({error})") from None


def read_some(port: serial.Serial) -> bytes:
    """All that has come, up to 512 bytes; waits for it, and gives nothing after `READ_TIMEOUT`.

    It takes one call to wait and one to read. `Serial.read` takes more, and after each of them this thread may have to
    wait for the interpreter.
    """
    file = port.fileno()
    ready, _, _ = select.select([file], [], [], READ_TIMEOUT)
    if not ready:
        return b""
    data = os.read(file, 512)
    if not data:
        raise OSError(errno.EIO, "it gives nothing although it says that it has something")
    return data


def reason(device: str, number: int | None, message: str) -> str:
    path = Path(device)
    if number == errno.ENOENT or not path.exists():
        return "no such device; is the board plugged in? (ls /dev/serial/by-id)"
    if number in (errno.EACCES, errno.EPERM):
        group = owner_group(path)
        return f"no permission; be in the group {group}: sudo usermod -aG {group} $USER, then log in anew"
    if number in (errno.EAGAIN, errno.EBUSY) or "lock" in message:
        return "in use by another program"
    if number in (errno.ENOTTY, errno.EINVAL) or "configure port" in message:
        return "is no serial port"
    return f"cannot be opened ({message})"


def owner_group(path: Path) -> str:
    number = os.stat(path).st_gid  # noqa: PTH116 (Path.group raises for a group without name)
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)
