"""Bags of other robots: stereo images, calibration and odometry of ROS 1, ROS 2 and MCAP, as steps of a navigator."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
import torch
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig
from ndtorch.navigation.stereo.calibration_files import PairCamera, StereoCalibration
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.ports import STAND, DriveCommand, StereoFrames

SIDES = (("left", "right"), ("cam0", "cam1"), ("infra1", "infra2"), ("image_0", "image_1"))
"""What the topics of a left and of a right camera are told by."""

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")

FIRST = 60
"""Images of the left camera from which the frame rate is taken."""

SLOWEST_M_PER_S = 1e-3
"""A robot that turns on the spot is taken to drive at this speed: a command has a curvature, which must be finite."""


class Topics(NamedTuple):
    """Topics of a stereo camera, of its calibration, and of odometry; None where there is none."""

    left: str
    right: str
    odometry: str | None

    def infos(self) -> tuple[str, str]:
        """Of the calibrations: beside the images."""
        left, right = (
            f"{topic.removesuffix('/compressed').rpartition('/')[0]}/camera_info" for topic in (self.left, self.right)
        )
        return left, right


class Pair(NamedTuple):
    """A pair of frames, and what was driven since the last one."""

    frames: StereoFrames
    driven: DriveCommand


class Source(Protocol):
    """A bag; it is opened for each question."""

    def topics(self) -> dict[str, str]:
        """The type of each topic."""
        ...

    def messages(self, topics: Sequence[str]) -> Iterator[tuple[str, Any]]:
        """Topic and message, in the order in which they were recorded."""
        ...


class RosSource:
    """A bag that `rosbags` opens: a folder of ROS 2 (sqlite3 or mcap), or a file of ROS 1."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def opened(self) -> AnyReader:
        return AnyReader([self.path], default_typestore=ros.typestore())

    def topics(self) -> dict[str, str]:
        with self.opened() as reader:
            return {connection.topic: connection.msgtype for connection in reader.connections}

    def messages(self, topics: Sequence[str]) -> Iterator[tuple[str, Any]]:
        with self.opened() as reader:
            kept = [connection for connection in reader.connections if connection.topic in topics]
            for connection, _, data in reader.messages(connections=kept):
                yield connection.topic, reader.deserialize(data, connection.msgtype)


class McapSource:
    """One file of MCAP with messages of ROS 2."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def topics(self) -> dict[str, str]:
        with self.path.open("rb") as file:
            summary = make_reader(file).get_summary()
        if summary is None:
            raise InputError("it has no index; `mcap recover` makes one")
        names = {number: schema.name for number, schema in summary.schemas.items()}
        return {c.topic: names.get(c.schema_id, "") for c in summary.channels.values() if c.message_encoding == "cdr"}

    def messages(self, topics: Sequence[str]) -> Iterator[tuple[str, Any]]:
        with self.path.open("rb") as file:
            for schema, channel, message in make_reader(file).iter_messages(topics=list(topics)):
                assert schema is not None
                yield channel.topic, ros.from_cdr(message.data, schema.name)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Whatever a file that is no bag, or a damaged one, does to the packages that read it is one `InputError`."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except FileNotFoundError:
        raise InputError(f"{path}: not there") from None
    except Exception as error:
        words = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: no bag that can be read ({words})") from None


class StereoBag:
    """The stereo camera of a bag.

    Images are rectified by the calibration unless it, or the name of their topics, says that they are.

    Args:
        path: a folder or file of ROS 2, a file of ROS 1, or one of MCAP.
        left, right: topics of the images; found by their names where there is one pair.
        odometry: topic; the first one of odometry by default.
        where: `camera_height`, `pitch` and `forward` of the rig, which no bag knows.

    Attributes:
        topics, rig, rate: what was found, and the frames a second.

    Raises:
        InputError: a bag that cannot be read, without such topics, or of another size than its calibration.
    """

    def __init__(
        self,
        path: Path,
        left: str | None = None,
        right: str | None = None,
        odometry: str | None = None,
        **where: float,
    ) -> None:
        self.path = path
        self.source: Source = McapSource(path) if path.suffix == ".mcap" and path.is_file() else RosSource(path)
        with reading(path):
            self.topics = find_topics(self.source.topics(), left, right, odometry)
            self.calibration = self.read_calibration()
            self.rate = self.frame_rate()
        assert self.calibration.size is not None
        (width, height), calibration = self.calibration.size, self.calibration
        self.rig = StereoRig.from_projections(
            calibration.left.projection, calibration.right.projection, width, height, **where
        )
        self.is_rectified = "rect" in self.topics.left.rpartition("/")[2].removesuffix("compressed")
        self.is_rectified = self.is_rectified or self.calibration.is_rectified

    def read_calibration(self) -> StereoCalibration:
        """Of the first camera_info of both cameras."""
        found: dict[str, Any] = {}
        topics = self.topics.infos()
        for topic, message in self.source.messages(topics):
            found.setdefault(topic, message)
            if len(found) == 2:
                break
        if len(found) < 2:
            raise InputError(f"no calibration: expected camera_info in {' and '.join(topics)}")
        left, right = (found[topic] for topic in topics)
        if (left.width, left.height) != (right.width, right.height):
            raise InputError("the calibrations of both cameras are of different sizes")
        return StereoCalibration(pair_camera(left), pair_camera(right), (left.width, left.height))

    def frame_rate(self) -> float:
        times = []
        for _, message in self.source.messages([self.topics.left]):
            times.append(ros.stamp_seconds(message))
            if len(times) == FIRST:
                break
        step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
        if not step > 0:
            raise InputError(f"{self.topics.left} has no images whose stamps increase")
        return 1 / step

    def pairs(self) -> Iterator[Pair]:
        """Pairs of frames taken within a quarter of a period of each other, with the motion since the last one."""
        with reading(self.path):
            yield from self.synchronised()

    def synchronised(self) -> Iterator[Pair]:
        waiting: tuple[deque[Any], deque[Any]] = (deque(), deque())
        moved, last = Motion(), -math.inf
        topics = [topic for topic in self.topics if topic is not None]
        for topic, message in self.source.messages(topics):
            if topic == self.topics.odometry:
                moved.add(message)
                continue
            waiting[topic == self.topics.right].append(message)
            while waiting[0] and waiting[1]:
                times = [ros.stamp_seconds(queue[0]) for queue in waiting]
                if abs(times[0] - times[1]) > 0.25 / self.rate:
                    waiting[times[0] > times[1]].popleft()
                    continue
                left, right = (queue.popleft() for queue in waiting)
                if min(times) > last:
                    last = min(times)
                    yield Pair(self.frames(left, right, last), moved.take())

    def frames(self, left: Any, right: Any, time: float) -> StereoFrames:
        images = [self.pixels(message) for message in (left, right)]
        if not self.is_rectified:
            arrays = self.calibration.rectify(*(image[0].permute(1, 2, 0).numpy() for image in images))
            images = [torch.from_numpy(np.atleast_3d(array)).permute(2, 0, 1)[None] for array in arrays]
        return StereoFrames(images[0], images[1], time)

    def pixels(self, message: Any) -> torch.Tensor:
        if hasattr(message, "encoding"):
            image = ros.image_pixels(message)
        else:
            decoded: Any = cv2.imdecode(np.asarray(message.data), cv2.IMREAD_ANYCOLOR)
            if decoded is None or decoded.dtype != np.uint8:
                raise InputError(f"an image that cannot be decoded ({message.format!r})")
            array = decoded[..., None] if decoded.ndim == 2 else cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB)
            image = torch.from_numpy(array).permute(2, 0, 1)[None]
        size = (image.shape[3], image.shape[2])
        if size != self.calibration.size:
            raise InputError(f"images of {size}, and a calibration of {self.calibration.size}")
        return image


class Motion:
    """Mean motion between frames, from the poses of odometry, or from its speeds where it gives only one pose."""

    def __init__(self) -> None:
        self.first: Any = None
        self.last: Any = None

    def add(self, message: Any) -> None:
        self.first = message if self.first is None else self.first
        self.last = message

    def take(self) -> DriveCommand:
        """Of the messages since the last call."""
        first, last = self.first, self.last
        self.first = last
        if last is None:
            return STAND
        dt = ros.stamp_seconds(last) - ros.stamp_seconds(first)
        speed, turn = last.twist.twist.linear.x, last.twist.twist.angular.z
        if dt > 0:
            (a, b), heading = (m.pose.pose.position for m in (first, last)), ros.yaw(first.pose.pose.orientation)
            turn = math.remainder(ros.yaw(last.pose.pose.orientation) - heading, math.tau) / dt
            direction = heading + turn * dt / 2
            ahead = (b.x - a.x) * math.cos(direction) + (b.y - a.y) * math.sin(direction)
            speed = ahead / dt
        if not (math.isfinite(speed) and math.isfinite(turn)):
            return STAND
        if abs(speed) < SLOWEST_M_PER_S:
            speed = SLOWEST_M_PER_S if abs(turn) > SLOWEST_M_PER_S else 0.0
        return DriveCommand(speed, turn / speed if speed else 0.0)


def pair_camera(info: Any) -> PairCamera:
    """A camera of a camera_info message, of ROS 2 or ROS 1."""
    k, d, r, p = (getattr(info, name, getattr(info, name.upper(), ())) for name in "kdrp")
    try:
        matrix, turn = (np.array(part, np.float64).reshape(3, 3) for part in (k, r))
        return PairCamera(matrix, np.array(d, np.float64).ravel(), turn, np.array(p, np.float64).reshape(3, 4))
    except ValueError:
        raise InputError("a camera_info that is incomplete") from None


def find_topics(kinds: dict[str, str], left: str | None, right: str | None, odometry: str | None) -> Topics:
    """The topics that were named, or those that can only be meant."""
    images = [topic for topic, kind in kinds.items() if kind in IMAGES]
    moves = [topic for topic, kind in kinds.items() if kind == "nav_msgs/msg/Odometry"]
    for topic, known in ((left, images), (right, images), (odometry, moves)):
        if topic is not None and topic not in known:
            raise InputError(f"no topic {topic} of this kind; there are {', '.join(known) or 'none'}")
    if left is None or right is None:
        pairs = [
            (topic, topic.replace(*names))
            for topic in images
            for names in SIDES
            if names[0] in topic and topic.replace(*names) in images and left in (None, topic)
        ]
        straight = [pair for pair in pairs if "rect" in pair[0]] or pairs
        if len(straight) != 1:
            raise InputError(f"name the left and the right topic of one stereo camera; there are {', '.join(images)}")
        left, right = straight[0]
    return Topics(left, right, odometry or (moves[0] if moves else None))
