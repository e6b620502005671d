"""From the loop of a car, driving or driven again from a recording, to its view."""

from __future__ import annotations

from collections import deque
from typing import Any

from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Report, Step
from ndtorch_robot.view.background import Background
from ndtorch_robot.view.car_view import CarView, Seen
from ndtorch_robot.view.drawing import PICTURES, levels


def start_view(stream: Any, runner: NavigatorRunner, report: Report | None, wait: bool = False) -> Background[Seen]:
    """The view of a car, in its own thread."""
    view = CarView(stream, runner.rig, runner.fields, levels(runner.navigator), runner.grid)
    return Background(view.show, view.close, report=report, wait=wait)


class Rate:
    """Lets so many times a second pass."""

    def __init__(self, rate: float) -> None:
        self.period, self.next = 1 / rate, 0.0

    def due(self, now: float) -> bool:
        """Whether it is time again."""
        if now < self.next - 1e-6:
            return False
        later = self.next + self.period
        self.next = later if later > now else now + self.period
        return True


class ViewSteps:
    """An observer of the loop. It hands references to the view's thread and never waits.

    Pictures are spared when the view does not follow; when it does not follow at all, steps are dropped, and
    the view says how many. A view that waits, for a replay, drops nothing.

    Args:
        view: of `CarView.show`.
        title: what is driven, where it is not a car now.
    """

    def __init__(self, view: Background[Seen], title: str = "") -> None:
        self.view, self.title = view, title
        self.lines: deque[str] = deque(maxlen=100)
        self.start: float | None = None
        self.pictures = Rate(PICTURES)

    def report(self, line: str) -> None:
        """Something happened; shown with the next step. From any thread."""
        self.lines.append(line)

    def __call__(self, step: Step) -> None:
        if self.view.failed:
            return
        if self.start is None:
            self.start = step.time
        now = step.time - self.start
        due = self.pictures.due(now)
        frames = step.frames if due and (self.view.wait or not self.view.busy) else None
        lines = tuple(self.lines.popleft() for _ in range(len(self.lines)))
        dropped = f"{self.view.dropped} steps not shown" if self.view.dropped else ""
        self.view.put(
            Seen(
                now,
                frames,
                step.state,
                step.wanted,
                step.sent,
                step.driven,
                step.standing,
                step.telemetry,
                lines,
                ", ".join(filter(None, (self.title, dropped))),
                step.placed is not None,
            )
        )
