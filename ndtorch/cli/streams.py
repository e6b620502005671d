"""Where a command prints: errors are one line, and nobody has to read what is reported."""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
from collections.abc import Callable
from typing import Any, TextIO, cast

PIECE = 4096
"""Bytes that a pipe takes at once where it takes any (`PIPE_BUF`)."""

PATIENCE_MS = 20.0
"""Time to wait for a reader. Then what is reported is dropped, until somebody reads again."""


def line(words: object) -> str:
    r"""An error or a remark as one line, with control characters as `\x1b` and the like: a terminal obeys none."""
    pattern = "[\x00-\x1f\x7f-\x9f\ud800-\udfff\u2028\u2029]"
    text = " ".join(str(words).split())
    return re.sub(pattern, lambda found: found[0].encode("unicode_escape").decode(), text)


class Unblocked:
    """A stream that never waits: what a full pipe or a stopped terminal does not take is dropped.

    A loop that holds wheels, and the end of a program, wait for nobody who has to read.

    Args:
        stream: of the system.
        waits: says whether to wait for the reader all the same, and to raise `OSError` where it is gone.
    """

    def __init__(self, stream: TextIO, waits: Callable[[], bool] = lambda: False) -> None:
        self.stream, self.number, self.patience, self.waits = stream, stream.fileno(), PATIENCE_MS, waits
        self.poll = select.poll()
        self.poll.register(self.number, select.POLLOUT)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        data = text.encode(self.stream.encoding, errors="backslashreplace")
        try:
            while data:
                ready = self.poll.poll(None if self.waits() else self.patience)
                self.patience = PATIENCE_MS if ready else 0.0
                if not ready:
                    break
                data = data[os.write(self.number, data[:PIECE]) :]
        except OSError:  # the reader is gone
            if self.waits():
                raise
        return len(text)

    def flush(self) -> None:
        """Nothing is kept back."""


def unblocked(stream: TextIO, waits: Callable[[], bool] = lambda: False) -> TextIO:
    """The stream as `Unblocked`, if it is one of the system's."""
    try:
        return cast("TextIO", Unblocked(stream, waits))
    except (AttributeError, OSError, ValueError):
        return stream


def open_closed_streams() -> None:
    """Where stdin, stdout or stderr is closed, let it lead nowhere: no file that is opened later takes its place."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        with contextlib.suppress(OSError):
            os.fstat(number)
            continue
        os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
        setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))
