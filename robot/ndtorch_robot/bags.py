"""Bags of other robots: stereo images, calibration and odometry of ROS 1, ROS 2 and MCAP, as steps of a navigator."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from rosbags.highlevel import AnyReader

from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig
from ndtorch.navigation.stereo.calibration_files import StereoCalibration, ros_camera
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.ports import STAND, DriveCommand, StereoFrames

SIDES = (("left", "right"), ("cam0", "cam1"), ("infra1", "infra2"), ("image_0", "image_1"))
"""Parts of the names of a left and of a right camera's topics."""

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")

FIRST_IMAGES, MIN_SPEED_M_PER_S = 60, 1e-3
"""Images from which the frame rate is taken, and speed of a robot that turns on the spot: curvatures are finite."""


class Topics(NamedTuple):
    """Topics of a stereo camera and of odometry; None where there is none."""

    left: str
    right: str
    odometry: str | None


@contextmanager
def reading(path: Path) -> Iterator[AnyReader]:
    """A bag; whatever a damaged one, or another file, does to the package that reads it is one `InputError`."""
    try:
        with AnyReader([path], default_typestore=ros.typestore()) as reader:
            yield reader
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:
        words = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: no bag that can be read ({words})") from None


class StereoBag:
    """The stereo camera of a bag.

    Images are rectified by the calibration unless it, or the name of their topics, says that they are.

    Args:
        path: a folder or file of ROS 2, a file of ROS 1, or one of MCAP.
        left, right: topics of the images; by default the only pair whose names differ by the side.
        odometry: topic; the first one of odometry by default.
        where: `camera_height`, `pitch` and `forward` of the rig, which no bag knows.

    Attributes:
        topics, rig, rate: topics and geometry that are used, and the frames a second.

    Raises:
        InputError: a bag that cannot be read, without such topics, or of another size than its calibration.
    """

    def __init__(
        self, path: Path, left: str | None = None, right: str | None = None, odometry: str | None = None, **where: float
    ) -> None:
        self.path = path
        with reading(path) as reader:
            kinds = {connection.topic: connection.msgtype for connection in reader.connections}
            self.topics = find_topics(kinds, left, right, odometry)
            folders = [topic.removesuffix("/compressed").rpartition("/")[0] for topic in self.topics[:2] if topic]
            names = [f"{folder}/camera_info" for folder in folders]
            infos: dict[str, Any] = {}
            for topic, message in messages(reader, names):
                infos.setdefault(topic, message)
                if len(infos) == 2:
                    break
            if len(infos) < 2:
                raise InputError(f"no calibration: expected camera_info in {' and '.join(names)}")
            left_info, right_info = (infos[name] for name in names)
            size = (int(left_info.width), int(left_info.height))
            if size != (right_info.width, right_info.height):
                raise InputError("the calibrations of both cameras are of different sizes")
            cameras = [ros_camera(vars(info), 1.0) for info in (left_info, right_info)]
            self.calibration = StereoCalibration(cameras[0], cameras[1], size)
            first = itertools.islice(messages(reader, [self.topics.left]), FIRST_IMAGES)
            stamps = [ros.stamp_seconds(message) for _, message in first]
        period = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
        if not period > 0:
            raise InputError(f"{path}: {self.topics.left} has no images whose stamps increase")
        self.rate, pair = 1 / period, self.calibration
        left_matrix, right_matrix, (width, height) = pair.left.projection, pair.right.projection, size
        self.rig = StereoRig.from_projections(left_matrix, right_matrix, width, height, **where)
        name = self.topics.left.removesuffix("/compressed").rpartition("/")[2]
        self.is_rectified = "rect" in name or pair.is_rectified

    def pairs(self) -> Iterator[tuple[StereoFrames, DriveCommand]]:
        """Frames taken within a quarter of a period of each other, with the mean motion since the last ones."""
        waiting: tuple[deque[Any], deque[Any]] = (deque(), deque())
        first, newest, last = None, None, -math.inf
        with reading(self.path) as reader:
            for topic, message in messages(reader, [topic for topic in self.topics if topic is not None]):
                if topic == self.topics.odometry:
                    first, newest = first or message, message
                    continue
                waiting[topic == self.topics.right].append(message)
                while waiting[0] and waiting[1]:
                    times = [ros.stamp_seconds(images[0]) for images in waiting]
                    if abs(times[0] - times[1]) > 0.25 / self.rate:
                        waiting[times[0] > times[1]].popleft()
                        continue
                    left, right = (images.popleft() for images in waiting)
                    if min(times) > last:
                        last = min(times)
                        yield self.frames(left, right, last), motion(first, newest)
                        first = newest

    def frames(self, left: Any, right: Any, time: float) -> StereoFrames:
        images = []
        for message in (left, right):
            if hasattr(message, "encoding"):
                image = ros.image_pixels(message)
            else:
                decoded = cv2.imdecode(np.asarray(message.data), cv2.IMREAD_ANYCOLOR)
                if decoded is None:
                    raise InputError(f"an image that cannot be decoded ({message.format!r})")
                array = np.atleast_3d(np.asarray(decoded, np.uint8))[..., ::-1]
                image = torch.from_numpy(np.ascontiguousarray(array)).permute(2, 0, 1)[None]
            if (image.shape[3], image.shape[2]) != self.calibration.size:
                raise InputError(f"images of {tuple(image.shape[:1:-1])}, and a calibration of {self.calibration.size}")
            images.append(image)
        if not self.is_rectified:
            arrays = self.calibration.rectify(*(image[0].permute(1, 2, 0).numpy() for image in images))
            images = [torch.from_numpy(np.atleast_3d(array)).permute(2, 0, 1)[None] for array in arrays]
        return StereoFrames(images[0], images[1], time)


def messages(reader: AnyReader, topics: list[str]) -> Iterator[tuple[str, Any]]:
    chosen = [connection for connection in reader.connections if connection.topic in topics]
    for connection, _, data in reader.messages(connections=chosen) if chosen else ():
        yield connection.topic, reader.deserialize(data, connection.msgtype)


def motion(first: Any, last: Any) -> DriveCommand:
    """Mean motion between two messages of odometry, by their poses, or by the speeds of the last one of one time."""
    if last is None:
        return STAND
    elapsed = ros.stamp_seconds(last) - ros.stamp_seconds(first)
    speed, turn = last.twist.twist.linear.x, last.twist.twist.angular.z
    if elapsed > 0:
        (a, b), heading = (m.pose.pose.position for m in (first, last)), ros.yaw(first.pose.pose.orientation)
        turn = math.remainder(ros.yaw(last.pose.pose.orientation) - heading, math.tau) / elapsed
        direction = heading + turn * elapsed / 2
        speed = ((b.x - a.x) * math.cos(direction) + (b.y - a.y) * math.sin(direction)) / elapsed
    if not (math.isfinite(speed) and math.isfinite(turn)):
        return STAND
    if abs(speed) < MIN_SPEED_M_PER_S:
        speed = MIN_SPEED_M_PER_S if abs(turn) > MIN_SPEED_M_PER_S else 0.0
    return DriveCommand(speed, turn / speed if speed else 0.0)


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
