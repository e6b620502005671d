"""Writing down a drive while it goes on: a queue, a thread, and MCAP files of ROS 2 messages, one an hour."""

from __future__ import annotations

import contextlib
import json
import math
import os
import threading
from collections import deque
from pathlib import Path
from time import monotonic
from typing import IO, Any, Literal, NamedTuple

from mcap.writer import Writer
from torch import Tensor

from ndtorch.arguments import as_path
from ndtorch.errors import InputError
from ndtorch.navigation import GridMap, Pose, Ranges, cut_strips
from ndtorch.navigation.mapping.grid_map import GridMapState
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.map_saving import APART
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.obstacles import seen_obstacles
from ndtorch_robot.ports import Closing, Report, Step
from ndtorch_robot.recording.streams import (
    END,
    HEADER,
    STEP,
    VERSION,
    crc_of,
    image_topic,
    images_of,
    jpeg,
    line_of,
    part_path,
)

FLUSH = 0.3
"""Seconds of a chunk, which is written at its end and then forced onto the disk: a cut file loses no more."""

PART = 3600.0
"""Seconds of a file: its index stays in memory until it is written, 1.2 KB a chunk."""

RESERVE = 100_000_000
"""Bytes to leave free on the disk, since a full one makes a computer fall over."""

WAIT = 0.4
"""Seconds after which a step is written without its frames, and no more frames are let into the queue: what a kill may
cost stays at this much, a chunk, and the time for one step's images."""

LINES = 20
"""So many times more steps may wait without their frames than with them."""

MAP_EVERY, PICTURE_EVERY, TOLD_EVERY = 5.0, 0.2, 1.0
"""Seconds between two maps, two whole pictures and two diagnostics."""

TYPES = (
    "std_msgs/msg/String",
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/CameraInfo",
    "sensor_msgs/msg/LaserScan",
    "nav_msgs/msg/Odometry",
    "nav_msgs/msg/OccupancyGrid",
    "tf2_msgs/msg/TFMessage",
    "geometry_msgs/msg/TwistStamped",
    "diagnostic_msgs/msg/DiagnosticArray",
)

CHUNK = 1 << 30
"""Bytes after which `mcap` would end a chunk by itself: never, so that every chunk holds whole steps."""


class Believed(NamedTuple):
    """What the navigator made of a step; `map` is None where none is due."""

    ranges: Ranges
    pose: Pose
    place: Pose
    map: GridMapState | None


class Waiting(NamedTuple):
    """One step on its way to the disk; `images` is None when there was no room for them."""

    step: Step
    line: dict[str, Any]
    images: dict[str, Tensor] | None
    believed: Believed | None
    since: float


class Recorder(Closing):
    """An observer that records every step into a new file, in its own thread; docs/file-formats.md has the topics.
    After every hour it goes on in another file, NAME-2.mcap and so on.

    Of whole frames the strips that the navigator reads are kept, lossless, and now and then a picture to look at. It
    never waits, and never raises for the disk: when the queue is full the step is kept without its frames, and when
    that is too much it is dropped; both are counted. When the disk fails, recording ends, `failed` says why, and
    driving goes on.

    Args:
        path: a new file, `NAME.mcap`.
        runner: what is recorded; None for frames alone, which are then kept whole.
        queue: steps that may wait with their frames.
        when_full: `"drop"`, or `"wait"` for a simulation, whose time stands still meanwhile.
        report: told when recording ends before it should.
        reserve: bytes to leave free on the disk.

    Attributes:
        parts: the files, in their order.
        steps, without_frames, dropped: steps written, those among them without frames, and those lost.
        failed: why recording has ended, or nothing.

    Raises:
        InputError: a file that is there already or cannot be made, or of another suffix; a queue of nothing.
    """

    def __init__(
        self,
        path: str | Path,
        runner: NavigatorRunner | None = None,
        *,
        queue: int = 60,
        when_full: Literal["drop", "wait"] = "drop",
        report: Report | None = None,
        reserve: int = RESERVE,
    ) -> None:
        path = as_path("path", path)
        if path.suffix != ".mcap":
            raise InputError(f"a recording is a file NAME.mcap, got {path}")
        if queue < 1:
            raise InputError(f"queue must be at least 1, got {queue}")
        self.path, self.runner = path, runner
        self.limit, self.when_full, self.report, self.reserve = queue, when_full, report, reserve
        self.steps = self.without_frames = self.dropped = self.pending = self.number = 0
        self.failed = ""
        self.waiting: deque[Waiting] = deque()
        self.changed = threading.Condition()
        self.closing = False
        self.next_map = self.next_picture = -math.inf
        self.told: tuple[str | None, float] = ("", -math.inf)
        self.began, self.flushed, self.now = math.nan, monotonic(), 0.0
        self.taken, self.kept = 0, (0, 0)
        self.last: Step | None = None
        self.places: dict[tuple[int, int], tuple[float, float]] = {}
        self.forcing: threading.Thread | None = None
        self.disk_error: Exception | None = None
        self.parts: list[Path] = []
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if part_path(path, 2).exists():
                raise FileExistsError
            ros.load_types(*TYPES)
            self.open_part()
        except FileExistsError:
            raise InputError(f"{path} exists already: choose another name") from None
        except OSError as error:
            raise InputError(f"{path}: cannot record into this file ({error.strerror})") from None
        self.thread = threading.Thread(target=self.run, name="recorder", daemon=True)
        self.thread.start()

    def open_part(self) -> None:
        """Begin the first file, or the next one."""
        path = part_path(self.path, len(self.parts) + 1)
        self.file, self.channels, self.part_began = path.open("xb"), dict[str, int](), math.nan
        self.writer: Any = Writer(self.file, chunk_size=CHUNK)
        self.parts.append(path)
        configuration = json.dumps({} if self.runner is None else self.runner.configuration())
        try:
            self.writer.start(profile="ros2", library="ndtorch")
            header = {"version": str(VERSION), "configuration": configuration, "crc": crc_of(configuration)}
            self.writer.add_metadata(HEADER, header)
            self.file.flush()
        except OSError:
            with contextlib.suppress(OSError):
                self.file.close()
            raise

    def end_part(self, given: int, **more: str) -> None:
        """Write the record that says that nothing is missing before step `given`, and the index."""
        counts = {"given": given, "steps": self.steps, "without_frames": self.without_frames}
        self.writer.add_metadata(END, {name: str(count) for name, count in counts.items()} | more)
        self.writer.finish()
        self.file.flush()

    def __call__(self, step: Step) -> None:
        self.record(step)

    def record(self, step: Step) -> bool:
        """Note one step; returns whether it will be written with its frames."""
        waiting = self.waiting_of(step)
        with self.changed:
            while self.when_full == "wait" and self.pending >= self.limit and not self.failed:
                self.changed.wait()
            if self.failed or self.closing:
                self.dropped += 1
                return False
            now, seen = monotonic(), bool(waiting.images)
            late = self.when_full == "drop" and bool(self.waiting) and now - self.waiting[0].since > WAIT
            room = not seen or (self.pending < self.limit and not late)
            if not room and len(self.waiting) >= LINES * self.limit:
                self.dropped += 1
                return False
            self.pending += room and seen
            self.waiting.append(waiting._replace(images=waiting.images if room else None, since=now))
            self.changed.notify_all()
        return room

    def waiting_of(self, step: Step) -> Waiting:
        """What is kept of a step, its number the next one."""
        step = step._replace(number=self.number)
        self.number += 1
        # A strip that is a view would keep its whole frame waiting with it.
        seen = {
            name: image.clone() if image.untyped_storage().nbytes() > 2 * image.numel() else image
            for name, image in self.images(step).items()
        }
        state, believed = step.state, None
        if state is not None:
            due = state.map is not None and step.time >= self.next_map
            self.next_map = step.time + MAP_EVERY if due else self.next_map
            # Taken here: the loop goes on to change the grid.
            near = state.ranges if self.runner is None else seen_obstacles(state, self.runner.navigator)
            believed = Believed(near, state.pose, state.place, state.map if due else None)
        return Waiting(step._replace(frames=None, state=None), line_of(step), seen, believed, monotonic())

    def images(self, step: Step) -> dict[str, Tensor]:
        """What is kept of the frames, by name: the strips, and the left and right picture where one is due."""
        frames = step.frames
        if frames is None:
            return {}
        found = images_of(frames.left, frames.right)
        if self.runner is None or "left/image" not in found:
            return found
        fields, rig = self.runner.fields, self.runner.rig
        if any(tuple(image.shape[-2:]) != (rig.height, rig.width) for image in found.values()):
            return found  # a broken camera: such frames are not used
        left, right = map(cut_strips, found.values(), fields, (rig, rig))
        pictures = {}
        if not step.time < self.next_picture:
            self.next_picture = step.time + PICTURE_EVERY
            pictures = {name.replace("image", "picture/compressed"): image for name, image in found.items()}
        return images_of(left, right) | pictures

    def run(self) -> None:
        """The thread: write until closed or the disk fails."""
        while True:
            with self.changed:
                if not self.waiting and not self.closing:
                    self.changed.wait(FLUSH)
                step = self.waiting.popleft() if self.waiting else None
                self.taken += step is not None
                if step is None and self.closing:
                    return
            pending = step is not None and bool(step.images)
            try:
                if step is not None:
                    if self.when_full == "drop" and not self.closing and monotonic() - step.since > WAIT:
                        # The queue was short when this came in, but its images take longer than there is time.
                        step = step._replace(images=None)
                    self.write(step)
                due = monotonic() - self.flushed >= FLUSH or abs(self.now - self.began) >= FLUSH
                if due and self.steps > self.kept[0]:
                    self.flush()
                    if self.now - self.part_began >= PART and step is not None:
                        self.end_part(step.step.number + 1, continued="1")
                        self.sync(ends=True)
                        self.open_part()
            except Exception as error:  # whatever it is, driving goes on
                self.fail(error)
                return
            with self.changed:
                self.pending -= pending
                self.changed.notify_all()

    def write(self, waiting: Waiting) -> None:
        """One step: what was seen and believed, and then the message that says what belongs to it."""
        step, images, taken = waiting.step, waiting.images or {}, waiting.line["taken"]
        self.now = step.time
        self.began = self.now if math.isnan(self.began) else self.began
        self.part_began = self.now if math.isnan(self.part_began) else self.part_began
        for name, image in images.items():
            frame, picture = f"camera_{name.split('/')[0]}", name.endswith("compressed")
            message = ros.compressed_image(jpeg(image), "jpeg", frame, taken) if picture else None
            self.add(image_topic(name), message or ros.image(image, frame, taken), step)
        if waiting.believed is not None:
            self.add_believed(waiting.believed, step)
        self.add("/cmd_vel", ros.twist_stamped(step.sent, step.time), step)
        standing, last = self.told
        if step.standing != standing or not abs(step.time - last) < TOLD_EVERY:
            self.told = step.standing, step.time
            self.add("/diagnostics", ros.diagnostics(step.standing, step.telemetry, step.time), step)
        names = [name for name in images if not name.endswith("compressed")]
        line = json.dumps(waiting.line | {"images": names}, default=str)
        self.add(STEP, ros.new("std_msgs/msg/String", line), step)
        self.steps += 1
        self.without_frames += waiting.images is None

    def add_believed(self, believed: Believed, step: Step) -> None:
        time, runner = step.time, self.runner
        if runner is not None and not self.channels.get("/scan"):
            for side, info in zip(("left", "right"), ros.camera_infos(runner.rig, time), strict=True):
                self.add(f"/camera/{side}/camera_info", info, step)
        self.add("/scan", ros.laser_scan(believed.ranges, time), step)
        self.add("/odom", ros.odometry(believed.pose, step.driven, time), step)
        self.add("/tf", ros.transforms(believed.pose, believed.place, time), step)
        if believed.map is not None and runner is not None and runner.grid is not None:
            cells = GridMap.normalise(runner.grid.inner(believed.map.cells))
            self.add("/map", ros.occupancy_grid(cells, runner.grid, time, list(self.places.values())), step)
        at = float(believed.place.x), float(believed.place.y)
        self.places[round(at[0] / APART), round(at[1] / APART)] = at
        self.last = step

    def add(self, topic: str, message: Any, step: Step) -> None:
        """A message of a step, the number of which is its sequence."""
        if topic not in self.channels:
            name = message.__msgtype__
            schema = self.writer.register_schema(name, "ros2msg", ros.definition(name).encode())
            self.channels[topic] = self.writer.register_channel(topic, "cdr", schema)
        when = max(0, round(step.time * 1e9))
        self.writer.add_message(self.channels[topic], when, ros.to_cdr(message), when, step.number)

    def flush(self) -> None:
        """End the chunk, give it to the disk, and see whether there is room for more.

        A slow disk takes seconds for that, in which the writing must go on, so it is waited for in a thread.
        """
        self.flushed, self.began = monotonic(), self.now
        if self.disk_error is not None:
            raise self.disk_error
        self.writer.flush()
        self.kept = self.steps, self.without_frames
        if self.forcing is None or not self.forcing.is_alive():
            self.sync()
        room = os.statvfs(self.path.parent)
        if room.f_bavail * room.f_frsize < self.reserve:
            raise OSError(f"the disk is full: less than {self.reserve / 1e6:.0f} MB are left")

    def sync(self, ends: bool = False) -> None:
        """Force the file onto the disk in a thread, and close it where it ends."""
        options = {"file": self.file, "ends": ends, "before": self.forcing}
        self.forcing = threading.Thread(target=self.force, kwargs=options, name="recorder-sync", daemon=True)
        self.forcing.start()

    def force(self, file: IO[bytes], ends: bool, before: threading.Thread | None) -> None:
        """Wait until the disk has it all; what goes wrong ends the recording at the next chunk."""
        if before is not None:
            before.join()
        try:
            os.fsync(file.fileno())
            if ends:
                file.close()
        except (OSError, ValueError) as error:  # ValueError: closed by the end of the recording meanwhile
            self.disk_error = error

    def fail(self, error: Exception) -> None:
        """End the recording with the last whole chunk."""
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        with self.changed:
            self.dropped += self.taken - self.kept[0] + len(self.waiting)
            self.steps, self.without_frames = self.kept
            self.failed = f"recording to {self.path} has stopped after {self.steps} steps: {reason}"
            self.waiting.clear()
            self.changed.notify_all()
        with contextlib.suppress(OSError, ValueError):
            self.file.close()
        if self.report is not None:
            self.report(self.failed)

    def close(self) -> None:
        """Write what is left, and the record that says that nothing is missing. Calling it again does nothing."""
        with self.changed:
            if self.closing:
                return
            self.closing = True
            self.changed.notify_all()
        self.thread.join()
        if self.failed:
            return
        try:
            if self.last is not None and self.runner is not None and self.runner.grid is not None:
                cells = self.runner.map_cells()
                final = ros.occupancy_grid(cells, self.runner.grid, self.last.time, list(self.places.values()))
                self.add("/map", final, self.last)
            self.flush()
            self.end_part(self.number)
            if self.forcing is not None:
                self.forcing.join()
            os.fsync(self.file.fileno())
            self.file.close()
        except OSError as error:
            self.fail(error)

    def summary(self) -> dict[str, Any]:
        return {
            "file": str(self.path),
            "steps": self.steps,
            "without_frames": self.without_frames,
            "dropped": self.dropped,
            "megabytes": round(sum(part.stat().st_size for part in self.parts if part.exists()) / 1e6, 3),
            "failed": self.failed,
        }
