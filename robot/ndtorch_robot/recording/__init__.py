"""Recording a drive, and driving the recording again; the format is in FORMAT.md."""

from ndtorch_robot.recording.observe import RecordSteps
from ndtorch_robot.recording.reading import RecordedStep, Recording, open_recording
from ndtorch_robot.recording.recorder import Recorder
from ndtorch_robot.recording.replay import Comparison, NavigatorPilot, make_pilot, replay

__all__ = [
    "Comparison",
    "NavigatorPilot",
    "RecordSteps",
    "RecordedStep",
    "Recorder",
    "Recording",
    "make_pilot",
    "open_recording",
    "replay",
]
