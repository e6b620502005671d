"""Recording a drive, and driving the recording again; the format is in FORMAT.md."""

from robot.recording.observe import RecordSteps
from robot.recording.reading import RecordedStep, Recording, open_recording
from robot.recording.recorder import Recorder
from robot.recording.replay import Comparison, NavigatorPilot, make_pilot, replay

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
