"""Opening a serial port, with errors that say what to do."""

from __future__ import annotations

import errno
import grp
import os
import select
from pathlib import Path
from typing import TYPE_CHECKING

from ndtorch.errors import InputError

if TYPE_CHECKING:
    import serial

WRITE_TIMEOUT = 0.05
READ_TIMEOUT = 0.02


def open_port(device: str, baud: int) -> serial.Serial:
    """Open a serial port for this program alone.

    Raises:
        InputError: no such device, no permission, in use, or no serial port.
    """
    import serial

    try:
        return serial.Serial(device, baud, timeout=READ_TIMEOUT, write_timeout=WRITE_TIMEOUT, exclusive=True)
    except serial.SerialException as error:
        raise InputError(f"{device}: {reason(device, error.errno, str(error))}") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{device}: is no serial port ({error})") from None


def read_some(port: serial.Serial) -> bytes:
    """All that has come, up to 512 bytes; waits for it, and gives nothing after `READ_TIMEOUT`.

    It takes one call to wait and one to read. `Serial.read` takes more, and after each of them this thread may have
    to wait for the interpreter.

    Raises:
        OSError: the port is gone.
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
    """Why a port cannot be opened, in words."""
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
    """Name of the group that a file belongs to."""
    number = os.stat(path).st_gid  # noqa: PTH116 (Path.group raises for a group without name)
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)
