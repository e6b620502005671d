"""Reading a recording back, also one that was cut short."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, cast
from zlib import crc32

from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.utils.files import TABLE_BYTES, open_regular, read_text
from ndtorch_robot.ports import DriveCommand, Placed, Step, StereoFrames
from ndtorch_robot.recording.recorder import HEADER, STEPS, VERSION
from ndtorch_robot.recording.streams import SUFFIXES, Format, crc_of, decode, frames_of, is_intact

LARGEST = 2**28
"""Bytes of the largest image that is read: more is no image of a camera."""

RECORDING_BYTES = 2**42
"""Most bytes of one file of a recording."""

LINE_BYTES = 2**20
"""Most bytes of the line of a step."""


@dataclass
class Recording:
    """A recording on the disk.

    Attributes:
        configuration: as given to `Recorder`.
        kind: format of the frames.
        complete: whether the last line says that the recording was closed; known after reading.
        trouble: why reading ended before the last line, or nothing; known after reading.
        missing: steps that were dropped, from gaps in their numbers; known after reading.
        damaged: lines that are not as they were written, or whose frames are not; known after reading.
    """

    folder: Path
    configuration: dict[str, Any]
    kind: Format
    complete: bool = False
    trouble: str = ""
    missing: int = 0
    damaged: int = 0
    files: dict[str, IO[bytes]] = field(default_factory=dict)

    @property
    def lossless(self) -> bool:
        return self.kind != "jpeg"

    def steps(self) -> Iterator[Step]:
        """All steps but those that are damaged or not wholly there.

        They are as `Recorder` was given them, without the state of the navigator; `frames` is None where they were
        not kept, and `sent` is what was wanted where nothing else was written down.
        """
        self.complete, self.trouble, self.missing, self.damaged = False, "", 0, 0
        expected = 0
        try:
            with open_regular(self.folder / STEPS, RECORDING_BYTES) as lines:
                for line in iter(lambda: lines.readline(LINE_BYTES), b""):
                    if not line.endswith(b"\n"):
                        self.trouble = self.trouble or "the last line was not written to its end"
                        return
                    step = self.step(line)
                    if self.complete:
                        return
                    if step is None:
                        self.damaged += 1
                        expected += 1
                        continue
                    self.missing += step.number - expected
                    expected = step.number + 1
                    yield step
        except OSError as error:
            raise InputError(f"{self.folder / STEPS}: cannot be read ({error.strerror})") from None
        finally:
            for file in self.files.values():
                file.close()
            self.files.clear()

    def step(self, line: bytes) -> Step | None:
        """A line as a step; None at the end, or for one that cannot be used."""
        if not is_intact(line):
            self.trouble = self.trouble or "a line is damaged"
            return None
        try:
            values = json.loads(line)
            if values.get("end"):
                self.complete = True
                return None
            number, (time,) = int(values["n"]), numbers([values["time"]], 1)
            commands = {
                key: DriveCommand(*numbers(values[key], 2)) for key in ("driven", "command", "sent") if key in values
            }
            driven, command = commands["driven"], commands["command"]
            where = values.get("frames")
            frames = None if where is None else self.frames(where, time)
            if where is not None and frames is None:
                self.trouble = self.trouble or f"the frames of step {number} are damaged, or not wholly there"
                return None
            placed = numbers(values["placed"], 3) if "placed" in values else None
            telemetry = dict(values.get("telemetry") or {})
            standing = telemetry.pop("standing", None)
            if not isinstance(standing, str | None):
                raise TypeError("standing must be text")
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
            self.trouble = self.trouble or "a line is damaged"
            return None
        return Step(
            number,
            time,
            frames,
            driven,
            command,
            commands.get("sent", command),
            standing=standing,
            used=bool(values.get("used", True)),
            restarted=bool(values.get("restarted", False)),
            placed=None if placed is None else cast("Placed", tuple(placed)),
            telemetry=telemetry,
        )

    def frames(self, where: dict[str, dict[str, Any]], time: float) -> StereoFrames | None:
        """The frames of a step, or None where some are missing."""
        found: dict[str, Tensor] = {}
        for name, place in where.items():
            channels, height, width = place["shape"]
            if not 0 <= place["bytes"] <= LARGEST or channels not in (1, 3) or not 0 < height * width <= LARGEST:
                return None
            data = self.bytes_of(name, place["at"], place["bytes"])
            if crc32(data) != place["crc"]:
                return None
            image = decode(data, (channels, height, width), self.kind)
            if image is None:
                return None
            found[name] = image
        return StereoFrames(*frames_of(found), time)

    def bytes_of(self, stream: str, at: int, count: int) -> bytes:
        file = f"{Path(stream).name}.{SUFFIXES[self.kind]}"
        if file not in self.files:
            try:
                self.files[file] = open_regular(self.folder / file, RECORDING_BYTES)
            except (OSError, InputError):
                return b""
        self.files[file].seek(at)
        return self.files[file].read(count)


def numbers(values: Any, count: int) -> list[float]:
    """So many finite numbers.

    Raises:
        ValueError: other ones, or other things.
    """
    found = [float(value) for value in values if isinstance(value, int | float)]
    if len(found) != count or len(values) != count or not all(map(math.isfinite, found)):
        raise ValueError(f"expected {count} numbers, got {values}")
    return found


def open_recording(folder: Path) -> Recording:
    """Open a recording.

    Raises:
        InputError: a folder without one, or one of another version.
    """
    path = folder / HEADER
    try:
        header = json.loads(read_text(path, TABLE_BYTES))
        if header["format"] != "ndtorch recording":
            raise KeyError
        version, kind, configuration = header["version"], header["frames"], header["configuration"]
        if not isinstance(kind, str) or not isinstance(configuration, dict):
            raise TypeError
        intact = header.pop("crc", None) == crc_of(header)
    except FileNotFoundError:
        raise InputError(f"{folder}: not a recording ({HEADER} is missing)") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(f"{path}: not the beginning of a recording") from None
    if version != VERSION or kind not in SUFFIXES:
        raise InputError(f"{path}: version {version} with {kind!r} frames, this program reads version {VERSION}")
    if not intact:
        raise InputError(f"{path}: damaged, its checksum does not fit")
    if not (folder / STEPS).exists():
        raise InputError(f"{folder}: the recording holds no steps ({STEPS} is missing)")
    return Recording(folder, configuration, cast("Format", kind))
