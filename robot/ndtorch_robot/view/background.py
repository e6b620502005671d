"""Showing things without making anybody wait: a bounded queue and a thread."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from ndtorch_robot.ports import Report

T = TypeVar("T")

PATIENCE = 5.0
"""Seconds to wait at the end for what has not been shown yet."""


class Background(Generic[T]):
    """Calls `show` with every item in a thread of its own.

    `put` returns at once. When the queue is full the item is dropped and counted. When `show` raises, showing is
    over, it is said once, and whoever gives items goes on.

    Args:
        show: may be slow, may hang, may raise.
        finish: called after the last item, in the same thread.
        size: items that may wait.
        report: told when showing ends before it should.
        wait: wait for room instead, for whoever has time. Not for a loop.

    Attributes:
        shown, dropped: items so far.
        failed: why showing has ended, or nothing.
    """

    def __init__(
        self,
        show: Callable[[T], None],
        finish: Callable[[], None],
        size: int = 30,
        report: Report | None = None,
        wait: bool = False,
    ) -> None:
        self.show, self.finish, self.report, self.wait = show, finish, report, wait
        self.queue: queue.Queue[T | None] = queue.Queue(size)
        self.shown = self.dropped = 0
        self.failed = ""
        self.thread = threading.Thread(target=self.run, name="view", daemon=True)
        self.thread.start()

    def put(self, item: T) -> bool:
        """Show this some time; False when it was dropped."""
        while not self.failed:
            try:
                self.queue.put(item, timeout=0.1) if self.wait else self.queue.put_nowait(item)
                return True
            except queue.Full:
                if not self.wait:
                    break
        self.dropped += 1
        return False

    @property
    def busy(self) -> bool:
        """Whether so much is waiting that large items should be spared."""
        return self.queue.qsize() > self.queue.maxsize // 3

    def run(self) -> None:
        """The thread."""
        try:
            while (item := self.queue.get()) is not None:
                self.show(item)
                self.shown += 1
            self.finish()
        except Exception as error:  # whatever it is, driving goes on
            self.failed = f"the view has ended: {' '.join(f'{type(error).__name__}: {error}'.split())}"
            if self.report is not None:
                self.report(self.failed)

    def close(self, patience: float = PATIENCE) -> None:
        """Show what is waiting, but for so many seconds at most: a viewer that hangs is left behind."""
        until = patience
        try:
            self.queue.put(None, timeout=until if not self.failed else 0.01)
        except queue.Full:
            until = 0.0
        self.thread.join(until)
        if self.thread.is_alive() and not self.failed:
            self.failed = "the viewer takes nothing: left behind"
            if self.report is not None:
                self.report(self.failed)
