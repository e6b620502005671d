"""Recording a car: an observer of its loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from ndtorch_robot.ports import LoopStep
from ndtorch_robot.recording.recorder import Recorder


class SeenStep(LoopStep, Protocol):
    """A step of the loop, and whether the navigator began anew in it."""

    @property
    def restarted(self) -> bool: ...


class RecordSteps:
    """An observer that records every step, those without good frames included.

    Where the navigator began anew, after it was not asked or while the car stood, is noted, and replayed.

    Args:
        recorder: where to.
        telemetry: asked in every step for what else is known, as JSON.
    """

    def __init__(self, recorder: Recorder, telemetry: Callable[[], dict[str, Any]] | None = None) -> None:
        self.recorder, self.telemetry = recorder, telemetry

    def __call__(self, step: SeenStep) -> None:
        used = step.state is not None and step.frames is not None
        more = self.telemetry() if self.telemetry is not None else {}
        self.recorder.record_step(
            step.frames,
            step.driven,
            step.wanted,
            more | {"standing": step.standing},
            sent=step.sent,
            restarted=step.restarted,
            used=used,
            time=step.time,
        )
