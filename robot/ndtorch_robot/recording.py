"""Recording a drive as an MCAP file of ROS 2 messages, and replaying it; docs/file-formats.md has the format."""

from __future__ import annotations

import contextlib
import json
import math
import os
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any, Literal, cast

import numpy as np
import torch
import zstandard
from mcap.records import Channel, Chunk, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.navigation import Body, Grid, Pose, Ranges, StereoRig, Strips, cut_strips
from ndtorch.navigation.model import STATIONARY
from ndtorch.navigation.options import options_of
from ndtorch.utils.files import open_regular
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.navigator_runner import NavigatorRunner, seen_obstacles
from ndtorch_robot.ports import DriveCommand, Observer, Placed, Report, Step, StereoFrames
from ndtorch_robot.step_thread import StepThread

VERSION = "4"

HEADER, END, STEP = "ndtorch", "ndtorch end", "/ndtorch/step"
"""Names of the metadata records at both ends of a recording, and topic of what replay needs beside the images."""

SEEN, ARRAY = "/ndtorch/seen", "std_msgs/msg/Float32MultiArray"
"""Topic and type of what the controller made of both subfields."""

TYPES = ("std_msgs/msg/String", ARRAY, "sensor_msgs/msg/Image", "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry")

FLUSH_S = 0.5
"""Duration of a chunk, which is written and forced onto the disk at its end: a cut file loses no more."""

RESERVE, MAX_BYTES, MAX_CHUNK_BYTES = 100_000_000, 2**42, 2**29
"""Bytes to leave free on the disk; most bytes of a recording, and of a record and what is compressed in it."""

GREY_SCALE = 64
"""Factor of the sums of red, green and blue, 0 to 765, in images of 16 bits, which can be looked at."""

MAP_HALF_M = 10.0
"""Distance from the start to the sides of the map of a car that made none."""


Waiting = tuple[Step, dict[str, Tensor], Ranges | None, Pose | None]
"""A step on its way to the disk, with its images by topic, and ranges and pose where the navigator gave some."""


class Recorder(StepThread):
    """An observer that records every step into a new file, in its own thread.

    Of whole frames what replay needs is kept: the sums of red, green and blue of the strips; while the car moves, in
    place of large fields (of controllers with `checks_near`) what the controller steers by. It never waits, and never
    raises for the disk: a step that finds the queue full is dropped and counted. When the disk fails, recording ends,
    `failed` says why, and driving goes on.

    Args:
        path: a new file, `NAME.mcap`.
        runner: what is recorded; None for frames alone, which are then kept whole.
        whole: keep frames as they come.

    Raises:
        InputError: a file that exists already or cannot be made, or of another suffix.
    """

    poll_s = FLUSH_S

    def __init__(
        self,
        path: str | Path,
        runner: NavigatorRunner | None = None,
        *,
        size: int = 60,
        when_full: Literal["drop", "wait"] = "drop",
        report: Report | None = None,
        whole: bool = False,
    ) -> None:
        self.path, self.runner, self.whole = Path(path), runner, whole
        self.steps, self.kept, self.number, self.flushed = 0, 0, 0, monotonic()
        self.channels: dict[str, int] = {}
        if self.path.suffix != ".mcap":
            raise InputError(f"a recording is a file NAME.mcap, got {path}")
        ros.load_types(*TYPES)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.file = self.path.open("xb")
            self.writer: Any = Writer(self.file, chunk_size=MAX_CHUNK_BYTES // 8)
            self.writer.start(profile="ros2", library="ndtorch")
            configuration = json.dumps({} if runner is None else runner.configuration())
            self.writer.add_metadata(HEADER, {"version": VERSION, "configuration": configuration})
            self.file.flush()
        except FileExistsError:
            raise InputError(f"{path} exists already: choose another name") from None
        except OSError as error:
            raise InputError(f"{path}: cannot record into this file ({error.strerror})") from None
        super().__init__(f"recording {path}", size, when_full, report)

    def __call__(self, step: Step) -> None:
        images, ranges, pose = self.images(step), None, None
        if step.state is not None:
            # Taken here: the loop goes on to change the grid.
            pose, ranges = step.state.pose, step.state.ranges
            if self.runner is not None:
                ranges = seen_obstacles(step.state, self.runner.navigator)
        self.number += 1
        self.put((step._replace(number=self.number - 1, state=None), images, ranges, pose))

    def images(self, step: Step) -> dict[str, Tensor]:
        """What is kept of frames, by topic: the strips, or whole images of a size that no runner reads."""
        kept, runner = dict[str, Tensor](), self.runner
        large = runner is not None and not self.whole and runner.navigator.controller.checks_near
        # Where the car stands or begins anew, the field is read to find out what is near.
        begins = step.number == 0 or step.restarted or step.placed is not None
        near = step.used and (begins or abs(step.driven.speed) <= STATIONARY)
        if large and step.state is not None and step.state.seen is not None:
            kept[SEEN] = torch.from_numpy(step.state.seen)
        for k, image in enumerate(() if step.frames is None else step.frames[:2]):
            side = ("left", "right")[k]
            if (
                runner
                and not self.whole
                and isinstance(image, Tensor)
                and image.shape[-2:] == (runner.rig.height, runner.rig.width)
            ):
                image = cut_strips(image, runner.fields[k], runner.rig)
            for name, part in (image._asdict() if isinstance(image, Strips) else {"image": image}).items():
                if part.dtype != torch.uint8 or part.ndim != 4 or part.shape[:2] not in ((1, 1), (1, 3)):
                    kind = f"{part.dtype} {tuple(part.shape)}"
                    raise InputError(f"only single uint8 frames [1, C, H, W] with C = 1 or 3 are recorded, got {kind}")
                if name == "field" and large and not near:
                    continue
                if name != "image" and part.shape[1] == 3:
                    part = (part.sum(1, keepdim=True, dtype=torch.int32) * GREY_SCALE).to(torch.uint16)
                kept[f"/camera/{side}/{name}"] = part.clone()
        return kept

    def handle(self, item: Waiting) -> None:
        """Write one step: its messages, and then the one that says what belongs to it."""
        step, images, ranges, pose = item
        self.steps += 1
        values = step._asdict() | {"telemetry": dict(step.telemetry), "images": list(images)}
        frames = values.pop("frames")
        values["taken"] = None if frames is None else frames.time
        messages = {
            topic: array_message(image) if topic == SEEN else ros.image(image, topic.split("/")[2], step.time)
            for topic, image in images.items()
        }
        if ranges is not None and pose is not None:
            messages |= {"/scan": ros.laser_scan(ranges, step.time)}
            messages |= {"/odom": ros.odometry(pose, step.driven, step.time)}
        messages[STEP] = ros.new("std_msgs/msg/String", json.dumps(values, default=str))
        when = max(0, round(step.time * 1e9))
        for topic, message in messages.items():
            if topic not in self.channels:
                name = message.__msgtype__
                definition, _ = ros.typestore().generate_msgdef(name, ros_version=2)
                schema = self.writer.register_schema(name, "ros2msg", definition.encode())
                self.channels[topic] = self.writer.register_channel(topic, "cdr", schema)
            self.writer.add_message(self.channels[topic], when, ros.to_cdr(message), when, step.number)

    def idle(self) -> None:
        if monotonic() - self.flushed >= FLUSH_S:
            self.flush()
            self.flushed = monotonic()

    def finish(self) -> None:
        self.flush()
        self.writer.add_metadata(END, {"given": str(self.number), "steps": str(self.steps)})
        self.writer.finish()
        self.file.close()

    def fail(self, words: str) -> None:
        super().fail(words)
        with contextlib.suppress(OSError, ValueError):
            self.file.close()
        self.steps = self.kept

    def close(self) -> None:
        super().close()
        self.dropped = self.number - self.steps

    def flush(self) -> None:
        """End the chunk, force it onto the disk, and check whether there is room for more."""
        self.writer.flush()
        os.fsync(self.file.fileno())
        self.kept = self.steps
        if shutil.disk_usage(self.path.parent).free < RESERVE:
            raise OSError(f"the disk is full: less than {RESERVE / 1e6:.0f} MB are left")

    def summary(self) -> dict[str, Any]:
        size = self.path.stat().st_size if self.path.exists() else 0
        counts = {"steps": self.steps, "dropped": self.dropped, "megabytes": round(size / 1e6, 3)}
        return {"file": str(self.path), **counts, "failed": self.failed}


@dataclass
class Recording:
    """A recording on the disk; `complete` and `missing` are known after reading."""

    path: Path
    configuration: dict[str, Any]  # of `NavigatorRunner`
    complete: bool = False  # whether its end says that it was closed
    missing: int = 0  # number of steps that are not there or damaged

    def steps(self) -> Iterator[Step]:
        """All steps but those that are damaged or not wholly there, without the state of the navigator.

        They are numbered from 0; of whole frames there are the strips that were read, in grey; a field that was not
        kept is one black pixel. `frames` is None where there were none.
        """
        self.complete, self.missing, expected = False, 0, 0
        topics: dict[int, str] = {}
        images: dict[str, Message] = {}
        for record in records(self.path):
            if isinstance(record, Metadata) and record.name == END:
                self.complete = True
                with contextlib.suppress(KeyError, ValueError):
                    self.missing += max(0, int(record.metadata["given"]) - expected)
            elif isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message) and topics.get(record.channel_id) != STEP:
                images[topics.get(record.channel_id, "")] = record
            elif isinstance(record, Message):
                try:
                    step = step_of(record, images)
                except Exception:  # whatever a message of wrong content does to the packages that read it
                    continue
                self.missing += max(0, step.number - expected)
                expected = step.number + 1
                yield step


def step_of(message: Message, images: dict[str, Message]) -> Step:
    values = json.loads(ros.from_cdr(message.data, "std_msgs/msg/String").data)
    driven, wanted, sent = (DriveCommand(*finite(values[key], 2)) for key in ("driven", "wanted", "sent"))
    placed = None if values["placed"] is None else cast("Placed", tuple(finite(values["placed"], 3)))
    standing, number = values["standing"], int(values["number"])
    if not isinstance(standing, str | None) or number != message.sequence:
        raise ValueError("not a step")
    (time,), frames = finite([values["time"]], 1), None
    if values["images"]:
        pair, seen = [], None
        if any(images[topic].sequence != number for topic in values["images"]):
            raise ValueError("an image is not there")
        if SEEN in values["images"]:
            array = ros.from_cdr(images[SEEN].data, ARRAY)
            seen = np.array(array.data, np.float32).reshape([part.size for part in array.layout.dim])
        for side in ("left", "right"):
            parts = {
                name: pixels_of(ros.from_cdr(images[topic].data, "sensor_msgs/msg/Image"))
                for name in ("image", "row", "field")
                if (topic := f"/camera/{side}/{name}") in values["images"]
            }
            black = torch.zeros(1, 1, 1, 1, dtype=torch.uint8)
            pair.append(parts["image"] if "image" in parts else Strips(parts.get("field", black), parts["row"]))
        frames = StereoFrames(pair[0], pair[1], finite([values["taken"]], 1)[0], seen)
    used, restarted, telemetry = bool(values["used"]), bool(values["restarted"]), dict(values["telemetry"])
    return Step(number, time, frames, driven, wanted, sent, None, standing, used, restarted, placed, telemetry)


def array_message(array: Tensor) -> Any:
    dims = [ros.new("std_msgs/msg/MultiArrayDimension", "", size, array[0].numel()) for size in array.shape]
    return ros.new(ARRAY, ros.new("std_msgs/msg/MultiArrayLayout", dims, 0), array.numpy().ravel())


def pixels_of(message: Any) -> Tensor:
    """Pixels `[1, C, H, W]` of an image of a recording; of a sum three colors with it."""
    part = ros.image_pixels(message)
    if message.encoding == "mono16":
        shape = part.shape[2:]
        sums = torch.from_numpy(np.frombuffer(bytes(message.data), "<u2").reshape(shape) // GREY_SCALE).to(torch.int32)
        part = torch.stack([(sums + rest) // 3 for rest in range(3)])[None].clamp(max=255).to(torch.uint8)
    return part


def finite(values: Any, count: int) -> list[float]:
    numbers = [float(value) for value in values if isinstance(value, int | float) and math.isfinite(value)]
    if len(numbers) != count or len(values) != count:
        raise ValueError(f"expected {count} numbers, got {values}")
    return numbers


def chunk_records(chunk: Chunk) -> list[Any]:
    """The records of a chunk; raises anything for one that is damaged, or larger than it says."""
    if chunk.compression not in ("", "zstd") or chunk.uncompressed_size > MAX_CHUNK_BYTES:
        raise ValueError("an unknown compression or size")
    if chunk.compression and zstandard.get_frame_parameters(chunk.data).content_size != chunk.uncompressed_size:
        raise ValueError("a size that does not fit")
    return breakup_chunk(chunk, validate_crc=True)


def records(path: Path) -> Iterator[Any]:
    """The records of a file of MCAP up to the last whole one, without those of damaged chunks."""
    try:
        # Whatever the end of a cut file and a damaged chunk do to the packages that read them.
        with open_regular(path, MAX_BYTES) as file, contextlib.suppress(Exception):
            for record in StreamReader(file, emit_chunks=True, record_size_limit=MAX_CHUNK_BYTES).records:
                inner = [record]
                if isinstance(record, Chunk):
                    inner = []
                    with contextlib.suppress(Exception):
                        inner = chunk_records(record)
                yield from inner
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def open_recording(path: str | Path) -> Recording:
    """Open a recording.

    Raises:
        InputError: what is none, or one of another version.
    """
    header = next((record for record in records(Path(path)) if isinstance(record, Metadata | Channel)), None)
    if not isinstance(header, Metadata) or header.name != HEADER:
        raise InputError(f"{path}: not a recording of ndtorch; `ndtorch import` reads those of others")
    version = header.metadata.get("version")
    if version != VERSION:
        raise InputError(f"{path}: version {version}, this program reads version {VERSION}")
    try:
        return Recording(Path(path), dict(json.loads(header.metadata["configuration"])))
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{path}: damaged, its configuration cannot be read") from None


def make_runner(configuration: dict[str, Any], mapping: bool = False) -> NavigatorRunner:
    """The runner of a recording.

    Args:
        mapping: make a map as well, as large as the car's own, or `MAP_HALF_M` to all sides where it made none.

    Raises:
        InputError: a configuration of something else than a navigator, or with unusable values.
    """
    try:
        options, rig = options_of(configuration), StereoRig(**configuration["rig"])
        sides = configuration["map_m"] or (-MAP_HALF_M, MAP_HALF_M, -MAP_HALF_M, MAP_HALF_M)
        grid = Grid(*map(float, sides)) if mapping else None
        rate, near, body = configuration["rate_hz"], configuration["near_check"], Body(**configuration.get("body", {}))
        return NavigatorRunner(options, rig, float(rate), grid, bool(near), body)
    except InputError:
        raise
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"the recording's configuration cannot be used: {type(error).__name__} {error}") from None


@dataclass
class Comparison:
    """How a replay compares with what was recorded."""

    steps: int = 0  # steps, same: number of steps replayed, and of those with the same command to the bit
    same: int = 0
    first_different: int | None = None  # number of the first other one


def replay(
    recording: Recording, runner: NavigatorRunner, observers: Iterable[Observer] = (), report: Report | None = None
) -> Comparison:
    """Run a runner on a recording and compare its commands.

    For observers `wanted` and `state` are of now, `sent` and `standing` of then. Stops are reported.
    """
    result, standing = Comparison(), None
    with torch.inference_mode():
        for step in recording.steps():
            if report is not None and step.standing != standing:
                report(f"resumed after: {standing}" if step.standing is None else f"stopped: {step.standing}")
                standing = step.standing
            if not step.used or step.frames is None:
                runner.roll(step.driven)
            else:
                wanted = runner.step(step.frames, step.driven, step.placed, step.restarted)
                result.steps += 1
                result.same += wanted == step.wanted
                if wanted != step.wanted and result.first_different is None:
                    result.first_different = step.number
                step = step._replace(wanted=wanted, state=runner.state)
            for observer in observers:
                observer(step)
    return result
