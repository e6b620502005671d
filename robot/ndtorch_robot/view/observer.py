"""From the loop of a car, real, simulated or replayed, to its view in a thread, with a queue that is bounded."""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Report, Step
from ndtorch_robot.sim.plan import Plan
from ndtorch_robot.view.archetypes import FRAMES_PER_SECOND, thresholds
from ndtorch_robot.view.car_view import CarView, Pose, Seen

T = TypeVar("T")

CLOSE_TIMEOUT = 5.0
"""Seconds to wait at the end for what has not been shown yet."""


class Background(Generic[T]):
    """Calls `show` with every item in a thread of its own.

    `put` returns at once. When the queue is full the item is dropped and counted. When `show` raises, showing is
    over, which is reported once, and the caller goes on.

    Args:
        show: may be slow, may hang, may raise.
        finish: called after the last item, in the same thread.
        size: items that may wait.
        report: called when showing ends before it should.
        wait: wait for room in the queue instead. Not for a loop in real time.

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
        try:
            while (item := self.queue.get()) is not None:
                self.show(item)
                self.shown += 1
            self.finish()
        except Exception as error:  # whatever it is, driving goes on
            self.failed = f"the view has ended: {' '.join(f'{type(error).__name__}: {error}'.split())}"
            if self.report is not None:
                self.report(self.failed)

    def close(self, patience: float = CLOSE_TIMEOUT) -> None:
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


def start_view(
    stream: Any, runner: NavigatorRunner, report: Report | None, wait: bool = False, plan: Plan | None = None
) -> Background[Seen]:
    """The view of a car, in its own thread.

    Args:
        stream: of `open_stream`.
        report: called when the view ends before it should.
        wait: wait for the view instead of dropping steps.
        plan: of the building, where it is known.
    """
    view = CarView(stream, runner.rig, runner.fields, thresholds(runner.navigator), runner.grid, plan)
    return Background(view.show, view.close, report=report, wait=wait)


class Rate:
    """Lets so many times a second pass."""

    def __init__(self, rate: float) -> None:
        self.period, self.next = 1 / rate, 0.0

    def due(self, now: float) -> bool:
        if now < self.next - 1e-6:
            return False
        later = self.next + self.period
        self.next = later if later > now else now + self.period
        return True


class ViewSteps:
    """An observer of the loop. It hands references to the view's thread and never waits.

    Frames are left out when the view is slow; when it is slower still, steps are dropped and counted. A view that
    waits, for a replay or a simulated drive, drops nothing.

    Args:
        view: of `start_view`.
        title: what is driven, where it is not a car now.
        truth: the true pose, where it is known.
    """

    def __init__(self, view: Background[Seen], title: str = "", truth: Callable[[], Pose] | None = None) -> None:
        self.view, self.title, self.truth = view, title, truth
        self.lines: deque[str] = deque(maxlen=100)
        self.start: float | None = None
        self.rate = Rate(FRAMES_PER_SECOND)

    def report(self, line: str) -> None:
        """Something happened; shown with the next step. From any thread."""
        self.lines.append(line)

    def __call__(self, step: Step) -> None:
        if self.view.failed:
            return
        if self.start is None:
            self.start = step.time
        now = step.time - self.start
        if not self.rate.due(now) or (self.view.busy and not self.view.wait):
            step = step._replace(frames=None)
        lines = tuple(self.lines.popleft() for _ in range(len(self.lines)))
        dropped = f"{self.view.dropped} steps not shown" if self.view.dropped else ""
        notes = ", ".join(filter(None, (self.title, dropped)))
        self.view.put(Seen(now, step, lines, notes, None if self.truth is None else self.truth()))
