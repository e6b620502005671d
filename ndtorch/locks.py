"""A file that one process holds at a time, and a word where it takes long. It imports no torch."""

from __future__ import annotations

import fcntl
import time
from collections.abc import Callable
from typing import IO

PATIENCE = 10.0
"""Seconds after which whoever waits is told so."""


def hold(file: IO[str], tell: Callable[[], None], patience: float = PATIENCE) -> None:
    """Wait until no other process holds the file, and hold it until it is closed, or this process is gone.

    A process that dies lets go; one that was stopped does not, so that somebody may wait for ever.

    Args:
        tell: called once where another has held it for `patience` seconds.
    """
    ends = time.monotonic() + patience
    while time.monotonic() < ends:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            time.sleep(0.02)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        tell()
        fcntl.flock(file, fcntl.LOCK_EX)
