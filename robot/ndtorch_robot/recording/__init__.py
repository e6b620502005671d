"""Recording a drive, and driving the recording again; the format is in docs/file-formats.md."""

from ndtorch_robot.recording.reading import Recording, open_recording
from ndtorch_robot.recording.recorder import Recorder
from ndtorch_robot.recording.replay import Comparison, make_runner, replay

__all__ = [
    "Comparison",
    "Recorder",
    "Recording",
    "make_runner",
    "open_recording",
    "replay",
]
