"""Bags of other robots: stereo images, calibration and odometry of ROS 1, ROS 2 and MCAP, as steps of a navigator."""

from __future__ import annotations

import itertools
import math
import stat
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from ndtorch.errors import InputError
from ndtorch.navigation import SearchParams, StereoRig, load_calibration
from ndtorch.navigation.stereo.calibration_files import ros_pair
from ndtorch.navigation.stereo.search import search_rows
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.ports import STAND, DriveCommand, StereoFrames

SIDES = (("left", "right"), ("cam0", "cam1"), ("infra1", "infra2"), ("image_0", "image_1"))
"""Parts of the names of a left and of a right camera's topics."""

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
MOTIONS = (
    "nav_msgs/msg/Odometry",
    *TRANSFORMS,
    *(f"geometry_msgs/msg/{name}Stamped" for name in ("Pose", "PoseWithCovariance", "Transform", "Twist")),
)
"""Kinds of topics of motion; the first one that a bag has is read."""
BODIES = ("base_link", "base_footprint", "base")
"""Frames of `/tf` whose place in `odom`, or in another frame, is that of the robot."""
OPTICAL = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""From the axes of an optical frame (right, down, ahead) to those of a body (ahead, left, up), REP 103."""

FIRST_IMAGES, MIN_SPEED_M_PER_S = 60, 1e-3
"""Images from which the frame rate is taken, and speed of a robot that turns on the spot: curvatures are finite."""
MOST_ROWS = 8
"""Rows by which images are moved against each other to find out why there are no ranges."""

Floats = npt.NDArray[np.float64]


class Topics(NamedTuple):
    """Topics of a stereo camera and of odometry; None where there is none."""

    left: str
    right: str
    odometry: str | None


@contextmanager
def reading(path: Path) -> Iterator[AnyReader]:
    """A bag; whatever a damaged one, or another file, does to the package that reads it is one `InputError`."""
    try:
        files = [path]
        if path.is_dir() and not (path / "metadata.yaml").exists():
            files = sorted(file for file in path.iterdir() if file.suffix in (".mcap", ".db3", ".bag")) or files
        if not all(stat.S_IFMT(file.stat().st_mode) in (stat.S_IFREG, stat.S_IFDIR) for file in files):
            raise InputError("no file or folder")
        with AnyReader(files, default_typestore=ros.typestore()) as reader:
            yield reader
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except Exception as error:
        words = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: no bag that can be read ({words})") from None


class StereoBag:
    """The stereo camera of a bag.

    Images are rectified by the calibration unless it, or the name of their topics, says that they are.

    Arguments are those of `ndtorch import`; `where` are `camera_height`, `pitch` and `forward` of the rig.

    Attributes:
        by_log: whether times are those at which messages were recorded, since images have no stamps that increase.
        later_s: seconds from the left image to the right one of each pair.
        alone: number of left and of right images without a partner.
        nearest_s: least seconds between images of both cameras.

    Raises:
        InputError: a bag that cannot be read, without such topics, or of another size than its calibration.
    """

    def __init__(
        self,
        path: Path,
        left: str | None = None,
        right: str | None = None,
        odometry: str | None = None,
        calibration: Sequence[Path] = (),
        apart_s: float | None = None,
        shift_s: float = 0.0,
        **where: Any,
    ) -> None:
        self.path, self.by_log, self.shift_s = path, False, shift_s
        with reading(path) as reader:
            kinds = {connection.topic: connection.msgtype for connection in reader.connections}
            self.topics = find_topics(kinds, left, right, odometry)
            self.period_s = 0.0  # of the slower camera
            for topic in self.topics[1::-1]:
                first = list(itertools.islice(self.messages(reader, [str(topic)]), FIRST_IMAGES))
                stamps = [ros.stamp_seconds(message) for _, message, _ in first]
                self.by_log |= len(stamps) > 1 and not np.median(np.diff(stamps)) > 0
                times = [self.time(message, log) for _, message, log in first]
                period = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
                if not period > 0:
                    raise InputError(f"{topic} has fewer than two images whose times increase")
                self.period_s = max(self.period_s, period)
            height, width = ros.image_pixels(first[0][1]).shape[2:]
            if calibration:
                self.calibration = load_calibration(*calibration, width=width, height=height)
            else:
                self.calibration = self.camera_infos(reader)
        if self.calibration.size != (width, height):
            raise InputError(f"{path}: images of {(width, height)}, and a calibration of {self.calibration.size}")
        self.rate, pair = 1 / self.period_s, self.calibration
        self.apart_s = self.period_s / 4 if apart_s is None else apart_s
        self.rig = StereoRig.from_projections(pair.left.projection, pair.right.projection, width, height, **where)
        name = self.topics.left.removesuffix("/compressed").rpartition("/")[2]
        self.is_rectified = pair.is_rectified or ("rect" in name and not calibration)

    def camera_infos(self, reader: AnyReader) -> Any:
        """The calibration in the topics camera_info beside those of the images."""
        folders = [topic.removesuffix("/compressed").rpartition("/")[0] for topic in self.topics[:2] if topic]
        names, infos = [f"{folder}/camera_info" for folder in folders], dict[str, Any]()
        for topic, message, _ in self.messages(reader, names):
            infos.setdefault(topic, message)
            if len(infos) == 2:
                break
        if len(infos) < 2:
            missing = " and ".join(name for name in names if name not in infos)
            raise InputError(f"no calibration: expected {missing} in the bag, or --calibration LEFT RIGHT")
        try:
            return ros_pair(*(vars(infos[name]) | {"roi": vars(infos[name].roi)} for name in names))
        except InputError as error:
            raise InputError(f"{names[0]}: {error}; --calibration LEFT RIGHT takes another one") from None

    def pairs(self) -> Iterator[tuple[StereoFrames, DriveCommand]]:
        """Frames taken at the same time, to `apart_s`, with the mean motion since the last ones."""
        waiting: tuple[deque[Any], deque[Any]] = (deque(), deque())
        self.moves, self.later_s, self.alone, self.nearest_s = Moves(), list[float](), [0, 0], math.inf
        last = -math.inf
        with reading(self.path) as reader:
            wanted = [topic for topic in self.topics if topic is not None]
            for topic, message, log in self.messages(reader, wanted):
                if topic == self.topics.odometry:
                    self.moves.add(message, self.time(message, log))
                    continue
                side = topic == self.topics.right
                waiting[side].append((self.time(message, log) - side * self.shift_s, message))
                while waiting[0] and waiting[1]:
                    times = [images[0][0] for images in waiting]
                    later = times[1] - times[0]
                    self.nearest_s = min(self.nearest_s, abs(later))
                    if abs(later) > self.apart_s:
                        waiting[later < 0].popleft()
                        self.alone[later < 0] += 1
                        continue
                    left, right = (images.popleft()[1] for images in waiting)
                    self.later_s.append(later)
                    if min(times) > last:
                        last = min(times)
                        yield self.frames(left, right, last), self.moves.mean()
        self.alone = [number + len(rest) for number, rest in zip(self.alone, waiting, strict=True)]

    def frames(self, left: Any, right: Any, time: float) -> StereoFrames:
        images = [ros.image_pixels(message) for message in (left, right)]
        for image in images:
            if (image.shape[3], image.shape[2]) != self.calibration.size:
                raise InputError(f"images of {tuple(image.shape[:1:-1])}, and a calibration of {self.calibration.size}")
        if not self.is_rectified:
            arrays = self.calibration.rectify(*(image[0].permute(1, 2, 0).numpy() for image in images))
            images = [torch.from_numpy(np.atleast_3d(array)).permute(2, 0, 1)[None] for array in arrays]
        return StereoFrames(images[0], images[1], time)

    def messages(self, reader: AnyReader, topics: Sequence[str]) -> Iterator[tuple[str, Any, float]]:
        """Topic, message and time of recording, s, in the order of these times."""
        chosen = [connection for connection in reader.connections if connection.topic in topics]
        for connection, log, data in reader.messages(connections=chosen) if chosen else ():
            yield connection.topic, reader.deserialize(data, connection.msgtype), log * 1e-9

    def time(self, message: Any, log: float) -> float:
        """The stamp of a message, s, or when it was recorded where it has none."""
        return log if self.by_log or not hasattr(message, "header") else ros.stamp_seconds(message) or log


class Moves:
    """The motion of a body in the plane, by poses, or by speeds where poses are missing or stay the same.

    `path_m` and `up_m` are how far it moved in the plane and across it, which is little if the axes are right.
    """

    def __init__(self) -> None:
        self.before: tuple[float, Floats, Floats] | None = None
        self.path_m = self.up_m = self.ahead = self.turn = self.elapsed = 0.0
        self.last = STAND

    def add(self, message: Any, time: float) -> None:
        """Take a message of one of `MOTIONS`."""
        if hasattr(message, "transforms"):
            parts = [part for part in message.transforms if part.child_frame_id.lstrip("/") in BODIES]
            parts.sort(key=lambda part: "odom" not in part.header.frame_id)
            if not parts:
                return
            message, time = parts[0], ros.stamp_seconds(parts[0]) or time
        frame = getattr(message, "child_frame_id", "") or message.header.frame_id
        axes = OPTICAL if "optical" in frame else np.eye(3)
        place, turned, linear, angular = pose_and_twist(message)
        now, before = (time, place, turned), self.before
        speeds = axes @ linear, axes @ angular
        if before is None or not time > before[0]:
            self.before = before or now
            self.last = command(speeds[0][0], speeds[1][2]) if before is None else self.last
            return
        elapsed, step, rotation = time - before[0], axes @ before[2].T @ (place - before[1]), before[2].T @ turned
        rotation = axes @ rotation @ axes.T
        if not step.any() and np.allclose(rotation, np.eye(3), atol=1e-12):
            step, turn = speeds[0] * elapsed, speeds[1][2] * elapsed
        else:
            turn = math.atan2(rotation[1, 0], rotation[0, 0])
        if np.isfinite(step).all() and math.isfinite(turn):
            self.before = now
            self.ahead += float(step[0] * math.cos(turn / 2) + step[1] * math.sin(turn / 2))
            self.turn, self.elapsed = self.turn + turn, self.elapsed + elapsed
            self.path_m, self.up_m = self.path_m + math.hypot(*step[:2]), self.up_m + abs(float(step[2]))

    def mean(self) -> DriveCommand:
        """Mean motion since the last call; the last one again where no message came since."""
        if self.elapsed > 0:
            self.last = command(self.ahead / self.elapsed, self.turn / self.elapsed)
        self.ahead = self.turn = self.elapsed = 0.0
        return self.last


def pose_and_twist(message: Any) -> tuple[Floats, Floats, Floats, Floats]:
    """Place `[3]`, rotation `[3, 3]`, linear and angular velocity `[3]`; no motion where a message has none."""
    pose, twist = getattr(message, "pose", None), getattr(message, "twist", None)
    pose, twist = getattr(pose, "pose", pose), getattr(twist, "twist", twist)
    if hasattr(message, "transform"):
        place, q = message.transform.translation, message.transform.rotation
    else:
        place, q = (None, None) if pose is None else (pose.position, pose.orientation)
    vectors = [place, *((None, None) if twist is None else (twist.linear, twist.angular))]
    at, linear, angular = (np.zeros(3) if v is None else np.array([v.x, v.y, v.z], np.float64) for v in vectors)
    has_heading = q is not None and math.hypot(q.x, q.y, q.z, q.w) > 0
    rotation = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix() if has_heading else np.eye(3)
    return at, rotation, linear, angular


def command(speed: float, turn: float) -> DriveCommand:
    if not (math.isfinite(speed) and math.isfinite(turn)):
        return STAND
    if abs(speed) < MIN_SPEED_M_PER_S:
        speed = MIN_SPEED_M_PER_S if abs(turn) > MIN_SPEED_M_PER_S else 0.0
    return DriveCommand(float(speed), float(turn / speed) if speed else 0.0)


def find_topics(kinds: dict[str, str], left: str | None, right: str | None, odometry: str | None) -> Topics:
    """The topics that were named, or those that can only be meant."""
    images = [topic for topic, kind in kinds.items() if kind in IMAGES]
    moves = [topic for kind in MOTIONS for topic in kinds if kinds[topic] == kind]
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
            there = f"there are {', '.join(images)}" if images else "there are no images"
            raise InputError(f"name the left and the right topic of one stereo camera; {there}")
        left, right = straight[0]
    return Topics(left, right, odometry or (moves[0] if moves else None))


def why_few_ranges(rig: StereoRig, frames: StereoFrames, params: SearchParams) -> str:
    """Which test of the search a pair of whole images fails, in a few words; empty where none stands out."""
    images = [image.float().mean(1)[0] / 255 for image in frames[:2] if isinstance(image, torch.Tensor)]
    steps = [float(image[rig.row].diff().abs().mean()) for image in images]
    side, ratio = ("left", "right")[steps[1] < steps[0]], min(steps) / max(*steps, 1e-9)
    if min(steps) < params.min_step_ratio / 4:
        return f"the row of the horizon of the {side} image is black, white or plain"
    if ratio < 0.25:
        return f"the {side} image is blurred or dark: its steps from pixel to pixel are {ratio:.2f} of the other's"

    def count(shift: int = 0, **changed: Any) -> int:
        """Places that are found, with other parameters or another row of the right image."""
        rows = torch.stack([image[[rig.row + down]] for image, down in zip(images, (0, shift), strict=True)])
        return int(search_rows(rows, replace(params, **{"rows": 1, "count": rig.width} | changed)).valid.sum())

    shifts = [shift for shift in range(-MOST_ROWS, MOST_ROWS + 1) if 0 <= rig.row + shift < rig.height]
    now, best = count(), max(shifts, key=count)
    if count(best) > max(2 * now, params.count):
        way = "lower" if best > 0 else "higher"
        return f"the right image is {abs(best)} rows {way} than the left one: not rectified, or by another calibration"
    far, near = (rig.focal * rig.baseline / px for px in (params.min_disparity_px, params.max_disparity_px))
    most = max(params.min_disparity_px + 2, min(2 * params.max_disparity_px, rig.width - 4 * params.half_width_px))
    tests: tuple[tuple[str, Any, str], ...] = (
        ("min_step_ratio", 0.0, "the images have too little contrast"),
        ("min_disparity_px", 1, f"what is in view is farther than {far:.2g} m"),
        ("max_disparity_px", most, f"what is in view is nearer than {near:.2g} m"),
        ("uniqueness_ratio", 1.0, "what is in view looks alike at many places"),
        ("agreement_ratio", 0.0, "the matches do not agree with those around them"),
        ("max_difference_ratio", 1.0, "the matches differ too much"),
    )
    for name, value, words in tests:
        if count(**{name: value}) > max(2 * now, params.count):
            return words
    return "" if now else "nothing of the left image is found in the right one"
