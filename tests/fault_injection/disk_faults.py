"""A recording onto a disk with faults, and a check of what was written."""

from __future__ import annotations

import errno
import os
import time
from pathlib import Path

from ndtorch_robot.ports import Step
from ndtorch_robot.recording.reading import open_recording
from ndtorch_robot.recording.recorder import Recorder

SLOW = 0.6
"""Seconds that each chunk takes on a slow disk."""


class FaultyRecorder(Recorder):
    """A recorder whose disk may be full or slow.

    Attributes:
        fault: `"full"`, `"slow"` or None.
    """

    fault: str | None = None

    def flush(self) -> None:
        """Write a chunk; a full disk takes none."""
        if self.fault == "full":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if self.fault == "slow":
            time.sleep(SLOW)
        super().flush()


class RecordingCheck:
    """An observer that records for the duration of a disk fault.

    Args:
        file: of the recording; it is removed at the end.
        fault: `"full"` or `"slow"`.
        lines: filled with the messages of the recorder.
    """

    def __init__(self, file: Path, fault: str, lines: list[str]) -> None:
        file.unlink(missing_ok=True)
        self.recorder = FaultyRecorder(file, report=lines.append)
        self.recorder.fault = fault

    def __call__(self, step: Step) -> None:
        self.recorder(step)

    def end(self) -> str | None:
        """Close the recording; returns what is wrong with it, or None.

        A full disk must have been reported, and all earlier steps must be readable. On a slow disk steps may be
        without frames, or missing, but each must be counted.
        """
        recorder, fault = self.recorder, self.recorder.fault
        recorder.fault = None
        recorder.close()
        read = sum(1 for _ in open_recording(recorder.path).steps())
        recorder.path.unlink(missing_ok=True)
        if fault == "full" and not recorder.failed:
            return "the full disk was not noticed"
        if fault == "slow" and recorder.failed:
            return f"the slow disk ended the recording: {recorder.failed}"
        if read != recorder.steps:
            return f"{recorder.steps} steps were written and {read} can be read"
        if recorder.steps + recorder.dropped != recorder.number:
            return f"{recorder.number} steps were given, {recorder.steps} written and {recorder.dropped} counted lost"
        return None
