"""A recording onto a disk that fails when told to, and a look at what is left of it."""

from __future__ import annotations

import errno
import os
import shutil
import time
from pathlib import Path

from ndtorch_robot.ports import Step
from ndtorch_robot.recording.observe import RecordSteps
from ndtorch_robot.recording.reading import open_recording
from ndtorch_robot.recording.recorder import Recorder

SLOW = 0.2
"""Seconds that each write takes on a slow disk."""


class FailingRecorder(Recorder):
    """A recorder whose disk may be full or slow.

    Attributes:
        fault: `"full"`, `"slow"` or None.
    """

    fault: str | None = None

    def append(self, file: str, data: bytes) -> None:
        """Write, if the disk does."""
        if self.fault == "full":
            super().append(file, data[: len(data) // 2])  # a full disk takes the first half
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if self.fault == "slow":
            time.sleep(SLOW)
        super().append(file, data)


class DiskTrial:
    """An observer: records into a new folder from its beginning to its end.

    Args:
        folder: for the recording; it is removed again.
        lines: what the recorder says.
    """

    def __init__(self, folder: Path, lines: list[str]) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        self.recorder = FailingRecorder(folder, {"program": "soak"}, format="raw", report=lines.append)
        self.record = RecordSteps(self.recorder)
        self.lines = lines

    def __call__(self, step: Step) -> None:
        self.record(step)

    def end(self, fault: str) -> str | None:
        """Close it; returns what is wrong with what is on the disk, or None.

        Of a full disk it must have been said, and all before that must be there. On a slow one steps may be without
        their frames, or missing, but all must be counted.
        """
        recorder = self.recorder
        recorder.fault = None
        recorder.close()
        read = sum(1 for _ in open_recording(recorder.folder).steps())
        shutil.rmtree(recorder.folder, ignore_errors=True)
        if fault == "full" and not recorder.failed:
            return "the full disk was not noticed"
        if fault == "slow" and recorder.failed:
            return f"the slow disk ended the recording: {recorder.failed}"
        if read != recorder.steps:
            return f"{recorder.steps} steps were written and {read} can be read"
        if recorder.steps + recorder.dropped != recorder.number:
            return f"{recorder.number} steps were given, {recorder.steps} written and {recorder.dropped} counted lost"
        return None
