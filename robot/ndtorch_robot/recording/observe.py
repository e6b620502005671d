"""Recording a car: an observer of its loop."""

from __future__ import annotations

from ndtorch_robot.ports import Step
from ndtorch_robot.recording.recorder import Recorder


class RecordSteps:
    """An observer that records every step, those without good frames included.

    Where the navigator began anew, after it was not asked or while the car stood, is noted, and replayed.
    """

    def __init__(self, recorder: Recorder) -> None:
        self.recorder = recorder

    def __call__(self, step: Step) -> None:
        self.recorder.record_step(
            step.frames,
            step.driven,
            step.wanted,
            {**step.telemetry, "standing": step.standing},
            sent=step.sent,
            placed=step.placed,
            restarted=step.restarted,
            used=step.used,
            time=step.time,
        )
