"""Signals that end a command: Ctrl-C, SIGTERM and SIGHUP, at any time and with what was computed kept."""

from __future__ import annotations

import contextlib
import logging
import signal
from collections.abc import Iterator
from types import FrameType

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a command as Ctrl-C does; the first and the last come from a terminal."""

CAME: list[int] = []
"""Numbers of the ending signals that came to this program: from then on nobody is waited for who has to read."""

log = logging.getLogger("ndtorch.signals")

NOTHING_KEPT = "stopped before there was anything to keep"
"""What is said then, where nothing was computed."""


@contextlib.contextmanager
def ended_like_ctrl_c() -> Iterator[list[int]]:
    """Every one of these signals raises KeyboardInterrupt inside: what was computed is kept.

    A signal that is ignored stays ignored, as `nohup` wants it; a handler that somebody else has set stays.

    Yields:
        `CAME`, empty at first.
    """
    came = CAME
    came.clear()

    def interrupt(number: int, frame: FrameType | None) -> None:
        came.append(number)
        raise KeyboardInterrupt

    old = {number: signal.getsignal(number) for number in ENDING}
    taken = [number for number, handler in old.items() if handler in (signal.SIG_DFL, signal.default_int_handler)]
    for number in taken:
        signal.signal(number, interrupt)
    try:
        yield came
    finally:
        for number in taken:
            signal.signal(number, old[number])


def figures_wanted() -> bool:
    """Whether there is time for figures: after SIGTERM there is none, and the log says so."""
    if signal.SIGTERM in CAME:
        log.info("SIGTERM: no figures are drawn")
    return signal.SIGTERM not in CAME
