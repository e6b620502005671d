"""Where a command prints: errors are one line, and nobody has to read what is reported."""

from __future__ import annotations

import contextlib
import os
import re
import select
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
    """

    def __init__(self, stream: TextIO) -> None:
        self.stream, self.number, self.patience = stream, stream.fileno(), PATIENCE_MS
        self.poll = select.poll()
        self.poll.register(self.number, select.POLLOUT)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        data = text.encode(errors="backslashreplace")
        with contextlib.suppress(OSError):  # the reader is gone
            for start in range(0, len(data), PIECE):
                ready = self.poll.poll(self.patience)
                self.patience = PATIENCE_MS if ready else 0.0
                if not ready:
                    break
                os.write(self.number, data[start : start + PIECE])
        return len(text)

    def flush(self) -> None:
        """Nothing is kept back."""


def unblocked(stream: TextIO) -> TextIO:
    """The stream as one that never waits, if it is one of the system's."""
    try:
        return cast("TextIO", Unblocked(stream))
    except (AttributeError, OSError, ValueError):
        return stream
