"""Writing down a drive while it goes on: a queue, a thread, and files that only grow."""

from __future__ import annotations

import json
import os
import threading
from collections import deque
from pathlib import Path
from time import monotonic
from typing import IO, Any, Literal, NamedTuple
from zlib import crc32

from torch import Tensor

from ndtorch.errors import InputError
from ndtorch_robot.ports import Closing, DriveCommand, Placed, Report, Step, StereoFrames
from ndtorch_robot.recording.streams import JPEG_QUALITY, SUFFIXES, Format, checked_line, crc_of, encode, images_of

VERSION = 2
HEADER, STEPS = "recording.json", "steps.jsonl"

SYNC = 1.0
"""Seconds after which everything is on the disk: what a power cut may cost. A kill costs only the queue."""

RESERVE = 100_000_000
"""Bytes to leave free on the disk, since a full one makes a computer fall over."""

WAIT = 0.4
"""Seconds after which a step is written without its frames, and no more frames are let into the queue: what a kill may
cost stays at this much and the time for one step's images."""

LINES = 20
"""So many times more steps may wait without their frames than with them."""


class Waiting(NamedTuple):
    """One step on its way to the disk; `frames` is None when there was no room for them."""

    line: dict[str, Any]
    frames: dict[str, Tensor] | None
    since: float


class Recorder(Closing):
    """Records steps into a new folder, in its own thread; the format is in docs/file-formats.md.

    `record_step` never waits, and never raises for the disk: when the queue is full the step is kept without its
    frames, and when that is too much it is dropped; both are counted. When the disk fails, recording ends,
    `failed` says why, and driving goes on.

    Args:
        folder: where to; made when missing, and must not hold a recording.
        configuration: whatever is needed to run the same loop again; goes into `recording.json`.
        format: `"png"` (lossless), `"jpeg"`, or `"raw"` (lossless, large, cheap).
        quality: of JPEG, 1..100.
        queue: steps that may wait with their frames.
        when_full: `"drop"`, or `"wait"` for a simulation, whose time stands still meanwhile.
        report: told when recording ends before it should.
        reserve: bytes to leave free on the disk.

    Attributes:
        steps, without_frames, dropped: steps written, those among them without frames, and those lost.
        failed: why recording has ended, or nothing.

    Raises:
        InputError: an unusable folder, or one that holds a recording; an option out of range.
    """

    def __init__(
        self,
        folder: Path,
        configuration: dict[str, Any],
        *,
        format: Format = "png",
        quality: int = JPEG_QUALITY,
        queue: int = 60,
        when_full: Literal["drop", "wait"] = "drop",
        report: Report | None = None,
        reserve: int = RESERVE,
    ) -> None:
        if format not in SUFFIXES or not 1 <= quality <= 100 or queue < 1:
            raise InputError(
                f"expected format png, jpeg or raw, quality 1..100 and queue >= 1, got {format}, {quality} and {queue}"
            )
        self.folder, self.kind, self.quality = folder, format, quality
        self.limit, self.when_full, self.report, self.reserve = queue, when_full, report, reserve
        self.steps = self.without_frames = self.dropped = self.pending = self.number = 0
        self.failed = ""
        self.waiting: deque[Waiting] = deque()
        self.changed = threading.Condition()
        self.closing = False
        self.ends: dict[str, int] = {}
        self.files: dict[str, IO[bytes]] = {}
        self.synced = monotonic()
        self.forcing: threading.Thread | None = None
        self.disk_error: Exception | None = None
        header = {"format": "ndtorch recording", "version": VERSION, "frames": format, "configuration": configuration}
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if (folder / HEADER).exists() or (folder / STEPS).exists():
                raise InputError(f"{folder} holds a recording already: choose another folder")
            text = json.dumps(header | {"crc": crc_of(header)}, indent=1)
            (folder / HEADER).write_text(text + "\n", encoding="utf-8")
            self.open(STEPS)
        except OSError as error:
            raise InputError(f"{folder}: cannot record into this folder ({error.strerror})") from None
        self.thread = threading.Thread(target=self.run, name="recorder", daemon=True)
        self.thread.start()

    def record_step(
        self,
        frames: StereoFrames | None,
        driven: DriveCommand,
        command: DriveCommand,
        telemetry: dict[str, Any] | None = None,
        *,
        sent: DriveCommand | None = None,
        placed: Placed = None,
        restarted: bool = False,
        used: bool = True,
        time: float | None = None,
    ) -> bool:
        """Note one step; returns whether it will be written with its frames.

        Args:
            frames: what the navigator read; None when the cameras gave nothing.
            driven: what it was told that the car had done.
            command: what it answered.
            telemetry: anything that JSON can hold.
            sent: what the drive made of the command.
            placed: where someone had put the car before this step, so that the navigator began anew.
            restarted: whether it began anew for another reason.
            used: False where the navigator was not asked.
            time: of a step without frames, s.
        """
        when = frames.time if frames is not None else time
        line: dict[str, Any] = {"n": self.number, "time": when, "driven": list(driven), "command": list(command)}
        line |= {"restarted": True} if restarted else {}
        line |= {} if used else {"used": False}
        line |= {} if sent is None else {"sent": list(sent)}
        line |= {} if placed is None else {"placed": list(placed)}
        line |= {} if telemetry is None else {"telemetry": telemetry}
        self.number += 1
        # A strip that is a view would keep its whole frame waiting with it.
        seen = {
            name: image.clone() if image.untyped_storage().nbytes() > 2 * image.numel() else image
            for name, image in (images_of(frames.left, frames.right) if frames is not None else {}).items()
        }
        with self.changed:
            while self.when_full == "wait" and self.pending >= self.limit and not self.failed:
                self.changed.wait()
            if self.failed or self.closing:
                self.dropped += 1
                return False
            now = monotonic()
            late = self.when_full == "drop" and bool(self.waiting) and now - self.waiting[0].since > WAIT
            room = not seen or (self.pending < self.limit and not late)
            if not room and len(self.waiting) >= LINES * self.limit:
                self.dropped += 1
                return False
            self.pending += room and bool(seen)
            self.waiting.append(Waiting(line, seen if room else None, now))
            self.changed.notify_all()
        return room

    def run(self) -> None:
        """The thread: write until closed or the disk fails."""
        while True:
            with self.changed:
                while not self.waiting and not self.closing:
                    self.changed.wait()
                if not self.waiting:
                    return
                step = self.waiting.popleft()
            pending = bool(step.frames)
            if self.when_full == "drop" and not self.closing and monotonic() - step.since > WAIT:
                # The queue was short when this came in, but its images take longer than there is time.
                step = step._replace(frames=None)
            try:
                self.write(step)
            except Exception as error:  # whatever it is, driving goes on
                self.fail(error)
                return
            with self.changed:
                self.pending -= pending
                self.changed.notify_all()

    def write(self, step: Waiting) -> None:
        """One step: first the frames, then the line that says where they are, so that no line lies."""
        where: dict[str, Any] = {}
        for name, image in (step.frames or {}).items():
            data = encode(image, self.kind, self.quality)
            file = f"{name}.{SUFFIXES[self.kind]}"
            size, shape = len(data), list(image.shape[1:])
            where[name] = {"at": self.ends.get(file, 0), "bytes": size, "shape": shape, "crc": crc32(data)}
            self.append(file, data)
        line = step.line | ({"frames": where} if where else {})
        self.append(STEPS, checked_line(line))
        self.steps += 1
        self.without_frames += step.frames is None
        if monotonic() - self.synced >= SYNC:
            self.sync()

    def open(self, file: str) -> IO[bytes]:
        """A file of the recording. Without a buffer: what is written survives the death of this process."""
        if file not in self.files:
            self.files[file] = (self.folder / file).open("xb", buffering=0)
        return self.files[file]

    def append(self, file: str, data: bytes) -> None:
        out, rest = self.open(file), memoryview(data)
        while rest:
            written = out.write(rest)
            rest = rest[written:]
        self.ends[file] = self.ends.get(file, 0) + len(data)

    def sync(self) -> None:
        """Have everything forced onto the disk, and see whether there is room for more.

        A slow disk takes seconds for that, in which the writing must go on, so it is done in a thread of its own.
        """
        self.synced = monotonic()
        if self.disk_error is not None:
            raise self.disk_error
        if self.forcing is None or not self.forcing.is_alive():
            files = list(self.files.values())
            self.forcing = threading.Thread(target=self.force, args=(files,), name="recorder-sync", daemon=True)
            self.forcing.start()
        room = os.statvfs(self.folder)
        if room.f_bavail * room.f_frsize < self.reserve:
            raise OSError(f"the disk is full: less than {self.reserve / 1e6:.0f} MB are left")

    def force(self, files: list[IO[bytes]]) -> None:
        """Wait until the disk has it all; what goes wrong ends the recording at the next step."""
        try:
            for file in files:
                os.fsync(file.fileno())
        except (OSError, ValueError) as error:  # ValueError: closed by the end of the recording meanwhile
            self.disk_error = error

    def fail(self, error: Exception) -> None:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        with self.changed:
            self.failed = f"recording to {self.folder} has stopped after {self.steps} steps: {reason}"
            self.dropped += len(self.waiting) + 1
            self.waiting.clear()
            self.changed.notify_all()
        for file in self.files.values():
            file.close()
        if self.report is not None:
            self.report(self.failed)

    def close(self) -> None:
        """Write what is left, and the last line that says that nothing is missing. Calling it again does nothing."""
        with self.changed:
            if self.closing:
                return
            self.closing = True
            self.changed.notify_all()
        self.thread.join()
        if self.failed:
            return
        try:
            last = {"end": True, "steps": self.steps, "without_frames": self.without_frames, "dropped": self.dropped}
            self.append(STEPS, checked_line(last))
            if self.forcing is not None:
                self.forcing.join()
            for file in self.files.values():
                os.fsync(file.fileno())
            for file in self.files.values():
                file.close()
        except OSError as error:
            self.fail(error)

    def summary(self) -> dict[str, Any]:
        sizes = sum(self.ends.values())
        return {
            "folder": str(self.folder),
            "frames": self.kind,
            "steps": self.steps,
            "without_frames": self.without_frames,
            "dropped": self.dropped,
            "megabytes": round(sizes / 1e6, 3),
            "failed": self.failed,
        }


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
