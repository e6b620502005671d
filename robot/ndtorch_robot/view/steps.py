"""From the loop of a car, or from a recording, to its view."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from ndtorch.navigation import Rect, StereoRig
from ndtorch.navigation.options import AnyNavigator
from ndtorch_robot.ports import DriveCommand, LoopStep
from ndtorch_robot.view.background import Background
from ndtorch_robot.view.car_view import CarView, Seen
from ndtorch_robot.view.drawing import PICTURES, levels

if TYPE_CHECKING:
    from ndtorch_robot.recording.reading import RecordedStep
    from ndtorch_robot.recording.replay import Pilot


def start_view(
    stream: Any,
    navigator: AnyNavigator,
    rig: StereoRig,
    fields: tuple[Rect, Rect],
    say: Callable[[str], None] | None,
    wait: bool = False,
) -> Background[Seen]:
    """The view of a car, in its own thread."""
    grid = navigator.grid_map.grid if navigator.grid_map is not None else None
    view = CarView(stream, rig, fields, levels(navigator), grid)
    return Background(view.show, view.close, say=say, wait=wait)


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
    the view says how many.

    Args:
        view: of `CarView.show`.
        telemetry: what the board says of itself.
    """

    def __init__(self, view: Background[Seen], telemetry: Callable[[], Mapping[str, Any]]) -> None:
        self.view, self.telemetry = view, telemetry
        self.lines: deque[str] = deque(maxlen=100)
        self.start: float | None = None
        self.pictures = Rate(PICTURES)

    def say(self, line: str) -> None:
        """Something happened; shown with the next step. From any thread."""
        self.lines.append(line)

    def __call__(self, step: LoopStep) -> None:
        if self.view.failed:
            return
        if self.start is None:
            self.start = step.time
        now = step.time - self.start
        frames = step.frames if self.pictures.due(now) and not self.view.busy else None
        lines = tuple(self.lines.popleft() for _ in range(len(self.lines)))
        dropped = self.view.dropped
        notes = f"{dropped} steps not shown" if dropped else ""
        commands = (step.wanted, step.sent, step.driven)
        self.view.put(Seen(now, frames, step.state, *commands, step.standing, self.telemetry(), lines, notes))


class ViewRecorded:
    """Shows the steps of a replay. It has time, so nothing is dropped.

    Args:
        view: of `CarView.show`.
        pilot: what drives the recording again.
    """

    def __init__(self, view: Background[Seen], pilot: Pilot) -> None:
        self.view, self.pilot = view, pilot
        self.start: float | None = None
        self.standing: str | None = None
        self.different = 0
        self.pictures = Rate(PICTURES)

    def __call__(self, step: RecordedStep, command: DriveCommand | None) -> None:
        if self.start is None:
            self.start = step.time
        now = step.time - self.start
        board = dict(step.telemetry or {})
        standing, before = board.pop("standing", None), self.standing
        self.standing = standing
        lines: list[str] = []
        if standing != before:
            lines.append(f"stopped: {standing}" if standing else f"resumed after: {before}")
        if command is not None and command != step.command:
            self.different += 1
            if self.different == 1:
                lines.append(f"step {step.number}: the replay wants something else than was recorded")
        self.view.put(
            Seen(
                now,
                step.frames if self.pictures.due(now) else None,
                self.pilot.state if command is not None else None,
                command or step.command,
                step.sent or step.command,
                step.driven,
                standing,
                board,
                tuple(lines),
                f"replay: {self.different} commands differ" if self.different else "replay",
                step.placed is not None,
            )
        )
