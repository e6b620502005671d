"""Observers that work in a thread of their own: recordings, views and the bridge to ROS 2."""

from __future__ import annotations

import contextlib
import queue
import threading
from typing import Any, Literal

from ndtorch_robot.ports import Closing, Report


class StepThread(Closing):
    """Handles what the loop gives it in a thread; the loop never waits, and drives on when the thread fails.

    Args:
        size: items that may wait.
        when_full: `"drop"` the new item, keep the `"newest"` alone, or `"wait"`, for a simulation or a replay.

    `close` waits for `patience` seconds at most: one that hangs is left behind. `idle` is called every `poll_s`
    seconds, or oftener.
    """

    patience: float | None = None
    poll_s: float | None = None

    def __init__(
        self, name: str, size: int, when_full: Literal["drop", "newest", "wait"] = "drop", report: Report | None = None
    ) -> None:
        self.name, self.when_full, self.report_failure = name, when_full, report
        self.queue: queue.Queue[Any] = queue.Queue(size)
        self.dropped, self.failed = 0, ""  # number of items that were not handled, and why it has ended
        self.thread = threading.Thread(target=self.run, name=name, daemon=True)
        self.thread.start()

    def handle(self, item: Any) -> None:
        raise NotImplementedError

    def idle(self) -> None:
        """Called after every item, and every `poll_s` seconds without one."""

    def finish(self) -> None:
        """Called at the end, unless it failed."""

    def put(self, item: Any) -> None:
        while not self.failed:
            try:
                return self.queue.put(item, timeout=0.1) if self.when_full == "wait" else self.queue.put_nowait(item)
            except queue.Full:
                if self.when_full == "drop":
                    break
                if self.when_full == "newest":
                    with contextlib.suppress(queue.Empty):
                        self.queue.get_nowait()
        self.dropped += 1

    def run(self) -> None:
        item: Any = self
        try:
            while item is not None:
                try:
                    item = self.queue.get(timeout=self.poll_s)
                    if item is not None:
                        self.handle(item)
                except queue.Empty:
                    pass
                self.idle()
            self.finish()
        except Exception as error:  # whatever it is, driving goes on
            reason = getattr(error, "strerror", None) or f"{type(error).__name__}: {error}"
            self.fail(" ".join(f"the {self.name} has ended: {reason}".split()))

    def fail(self, words: str) -> None:
        self.failed = words
        if self.report_failure is not None:
            self.report_failure(words)

    def close(self) -> None:
        """Handle what is waiting."""
        patience = self.patience
        if not self.failed and self.thread.is_alive():
            try:
                self.queue.put(None, timeout=patience)
            except queue.Full:
                patience = 0.0
        self.thread.join(patience)
        if self.thread.is_alive() and not self.failed:
            self.fail(f"the {self.name} hangs: left behind")
