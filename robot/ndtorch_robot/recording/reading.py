"""Reading a recording back, also one that was cut short or damaged."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Metadata
from mcap.stream_reader import MAGIC_SIZE, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from ndtorch.arguments import as_path
from ndtorch.errors import InputError
from ndtorch.utils.files import open_regular
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.ports import Step, StereoFrames
from ndtorch_robot.recording.streams import (
    END,
    HEADER,
    STEP,
    VERSION,
    crc_of,
    frames_of,
    image_topic,
    part_path,
    step_of,
)

RECORDING_BYTES = 2**42
"""Most bytes of a recording."""

CHUNK_BYTES = 2**29
"""Most bytes of a record, and of what is compressed in it."""

IMAGE = "sensor_msgs/msg/Image"

OLD = "is a recording of ndtorch 0.2 or older: ndtorch-robot==0.2.0 replays it"


@dataclass
class Recording:
    """A recording on the disk.

    Attributes:
        configuration: of `NavigatorRunner`.
        complete: whether its end says that the recording was closed; known after reading.
        trouble: why reading ended before that, or nothing; known after reading.
        missing: steps that are not there, from gaps in their numbers; known after reading.
        damaged: chunks and steps that are not as they were written; known after reading.
        continued: whether the part that was read last says that another one follows.
    """

    path: Path
    configuration: dict[str, Any]
    complete: bool = False
    trouble: str = ""
    missing: int = 0
    damaged: int = 0
    topics: dict[int, str] = field(default_factory=dict)
    continued: bool = False

    def steps(self) -> Iterator[Step]:
        """All steps of all parts but those that are damaged or not wholly there.

        They are as `Recorder` was given them, without the state of the navigator, and numbered from 0; of whole frames
        there are the strips that were read, and `frames` is None where they were not kept.
        """
        self.trouble, self.missing, self.damaged = "", 0, 0
        expected = 0
        for number in itertools.count(1):
            self.complete = self.continued = False
            self.topics.clear()
            path = part_path(self.path, number)
            try:
                with open_regular(path, RECORDING_BYTES) as file:
                    for opcode, content in records(file):
                        if opcode == Opcode.METADATA:
                            expected = self.end(content, expected)
                        for step in self.chunk(content) if opcode == Opcode.CHUNK else ():
                            self.missing += max(0, step.number - expected)
                            expected = step.number + 1
                            yield step
            except OSError as error:
                if number == 1:
                    raise InputError(f"{path}: cannot be read ({error.strerror})") from None
                self.trouble = self.trouble or f"{path}: cannot be read ({error.strerror})"
            if not self.continued:
                break
        if not self.complete:
            self.trouble = self.trouble or "its end was not written"

    def end(self, content: bytes, expected: int) -> int:
        """The number of the next step, where metadata are those of the end: none."""
        try:
            told = Metadata.read(ReadDataStream(BytesIO(content)))
            if told.name == END:
                given = int(told.metadata["given"])
                self.continued = "continued" in told.metadata
                self.complete, self.missing = not self.continued, self.missing + max(0, given - expected)
                return given
        except Exception:  # whatever a damaged record does to the package that reads it
            self.note("a record is damaged")
        return expected

    def note(self, trouble: str) -> None:
        self.damaged += 1
        self.trouble = self.trouble or trouble

    def chunk(self, content: bytes) -> Iterator[Step]:
        """The steps of a chunk; none of one that is damaged."""
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(content)))
            if chunk.compression == "zstd":
                size = zstandard.get_frame_parameters(chunk.data).content_size
                if not size == chunk.uncompressed_size <= CHUNK_BYTES:
                    raise ValueError("a size that does not fit")
            elif chunk.compression:
                raise ValueError("an unknown compression")
            found = breakup_chunk(chunk, validate_crc=True)
        except Exception:  # whatever a damaged chunk does to the packages that read it
            self.note("a chunk is damaged")
            return
        images: dict[str, bytes] = {}
        for record in found:
            if isinstance(record, Channel):
                self.topics[record.id] = record.topic
            elif isinstance(record, Message):
                topic = self.topics.get(record.channel_id, "")
                if topic == STEP:
                    step = self.step(record.data, images)
                    images = {}
                    if step is not None:
                        yield step
                else:
                    images[topic] = record.data

    def step(self, data: bytes, images: dict[str, bytes]) -> Step | None:
        """A message as a step, with its images by topic; None for one that cannot be used."""
        try:
            step, taken, names = step_of(ros.from_cdr(data, "std_msgs/msg/String").data)
            if not names:
                return step
            found = {name: ros.image_pixels(ros.from_cdr(images[image_topic(name)], IMAGE)) for name in names}
            return step._replace(frames=StereoFrames(*frames_of(found), taken))
        except Exception:  # whatever a message of wrong content does to the packages that read it
            self.note("a step is damaged, or its frames are not there")
            return None


def records(file: IO[bytes]) -> Iterator[tuple[int, bytes]]:
    """Records of a file of MCAP, opcode and content, up to the last whole one."""
    if file.read(MAGIC_SIZE) != MCAP0_MAGIC:
        raise InputError(f"{file.name}: not a recording")
    while len(head := file.read(9)) == 9:
        length = int.from_bytes(head[1:], "little")
        if length > CHUNK_BYTES or len(content := file.read(length)) != length:
            return
        yield head[0], content
        if head[0] == Opcode.FOOTER:
            return


def open_recording(path: str | Path) -> Recording:
    """Open a recording.

    Raises:
        InputError: what is none, or one of another version.
    """
    path = as_path("path", path)
    if path.is_dir() and (path / "recording.json").exists():
        raise InputError(f"{path} {OLD}")
    try:
        with open_regular(path, RECORDING_BYTES) as file:
            for opcode, content in records(file):
                if opcode == Opcode.METADATA:
                    return Recording(path, configuration_of(path, content))
                if opcode == Opcode.CHUNK:
                    break
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    raise InputError(f"{path}: not a recording of ndtorch; `ndtorch import` reads those of others")


def configuration_of(path: Path, content: bytes) -> dict[str, Any]:
    """What the metadata at the beginning hold. Raises `InputError`: of another version, or damaged."""
    try:
        told = Metadata.read(ReadDataStream(BytesIO(content)))
        text, version = told.metadata["configuration"], told.metadata["version"]
        intact = told.name == HEADER and told.metadata["crc"] == crc_of(text)
        configuration = json.loads(text)
    except Exception:  # whatever a damaged record does to the package that reads it
        raise InputError(f"{path}: not the beginning of a recording") from None
    if version != str(VERSION):
        raise InputError(f"{path}: version {version}, this program reads version {VERSION}")
    if not intact or not isinstance(configuration, dict):
        raise InputError(f"{path}: damaged, its checksum does not fit")
    return configuration
