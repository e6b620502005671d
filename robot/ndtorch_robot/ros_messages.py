"""What a car sees, does and believes as standard ROS 2 messages, for recordings and the live bridge alike.

Frames follow REP 105: `map` -> `odom` (what the localiser has corrected) -> `base_link`, the body frame of `StereoRig`:
x forward, y left. A message is an object of the definitions of `rosbags`, with the fields of its ROS type.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import cv2
import numpy as np
import torch
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from ndtorch.errors import InputError
from ndtorch.navigation import Pose, Ranges
from ndtorch_robot.ports import DriveCommand

MAP, ODOM, BASE = "map", "odom", "base_link"

RANGE_MIN, RANGE_MAX = 0.02, 100.0
"""Smallest and largest range of a scan, m."""


@cache
def typestore() -> Typestore:
    """All message definitions of ROS 2."""
    return get_typestore(Stores.ROS2_HUMBLE)


def load_types(*names: str) -> None:
    """Make the code that writes messages of these types: some .4 s, in which a loop would stand."""
    for name in names:
        typestore().get_msgdef(name)


def new(name: str, *fields: Any) -> Any:
    """A message of a type such as `"nav_msgs/msg/Odometry"` from all its fields, in their order."""
    return typestore().types[name](*fields)


def to_cdr(message: Any) -> bytes:
    """A message as ROS 2 sends it: CDR, little endian, with its header of 4 bytes."""
    return bytes(typestore().serialize_cdr(message, message.__msgtype__))


def from_cdr(data: bytes, name: str) -> Any:
    """The message of a type again."""
    return typestore().deserialize_cdr(data, name)


def header(time: float, frame: str) -> Any:
    """A header whose stamp is `time`, s since 1970 or since the start of a clock."""
    stamp = divmod(round(time * 1e9), 10**9)
    return new("std_msgs/msg/Header", new("builtin_interfaces/msg/Time", *stamp), frame)


def stamp_seconds(message: Any) -> float:
    """The stamp of a message with a header, s."""
    stamp = message.header.stamp
    return float(stamp.sec + stamp.nanosec * 1e-9)


def vector(x: float = 0.0, y: float = 0.0, z: float = 0.0, name: str = "Vector3") -> Any:
    return new(f"geometry_msgs/msg/{name}", float(x), float(y), float(z))


def quaternion(heading: float) -> Any:
    return new("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2))


def twist(command: DriveCommand) -> Any:
    """`geometry_msgs/Twist`: speed and curvature as linear and angular velocity, m/s and rad/s."""
    return new("geometry_msgs/msg/Twist", vector(command.speed), vector(z=command.speed * command.curvature))


def laser_scan(ranges: Ranges, time: float) -> Any:
    """`sensor_msgs/LaserScan` of places `[n]` about the middle of the body: the nearest one in each degree.

    Beams without a place are NaN, "no measurement" of REP 117: nothing says that the path is free there.
    """
    valid = np.asarray(ranges.valid).reshape(-1)
    x, y = (np.asarray(part, np.float64).reshape(-1)[valid] for part in (ranges.x, ranges.y))
    beam = np.rint(np.degrees(np.arctan2(y, x))).astype(int) + 90
    ahead = (beam >= 0) & (beam <= 180)
    near = np.full(181, np.nan, np.float32)
    np.fmin.at(near, beam[ahead], np.hypot(x, y)[ahead].astype(np.float32))
    angles, limits = (-math.pi / 2, math.pi / 2, math.pi / 180), (RANGE_MIN, RANGE_MAX)
    empty = np.zeros(0, np.float32)
    return new("sensor_msgs/msg/LaserScan", header(time, BASE), *angles, 0.0, 0.0, *limits, near, empty)


def odometry(pose: Pose, driven: DriveCommand, time: float) -> Any:
    """`nav_msgs/Odometry`: dead reckoning and the motion it was told. Covariances are zero: they are not known."""
    unknown = np.zeros(36)
    turned, place = quaternion(float(pose.heading)), vector(pose.x, pose.y, name="Point")
    at = new("geometry_msgs/msg/PoseWithCovariance", new("geometry_msgs/msg/Pose", place, turned), unknown)
    moved = new("geometry_msgs/msg/TwistWithCovariance", twist(driven), unknown)
    return new("nav_msgs/msg/Odometry", header(time, ODOM), BASE, at, moved)


def transforms(pose: Pose, corrected: Pose, time: float) -> Any:
    """`tf2_msgs/TFMessage`: `odom` -> `base_link` is dead reckoning, `map` -> `odom` is what corrects it."""
    turn = float(corrected.heading) - float(pose.heading)
    cos, sin, x, y = math.cos(turn), math.sin(turn), float(pose.x), float(pose.y)
    origin = Pose(float(corrected.x) - cos * x + sin * y, float(corrected.y) - sin * x - cos * y, turn)
    return new("tf2_msgs/msg/TFMessage", [transform(MAP, ODOM, origin, time), transform(ODOM, BASE, pose, time)])


def transform(parent: str, child: str, pose: Pose, time: float) -> Any:
    moved = new("geometry_msgs/msg/Transform", vector(pose.x, pose.y), quaternion(float(pose.heading)))
    return new("geometry_msgs/msg/TransformStamped", header(time, parent), child, moved)


def image(pixels: torch.Tensor, frame: str, time: float) -> Any:
    """`sensor_msgs/Image` of `[1, C, H, W]` uint8, C = 3 (RGB) or 1, or of uint16, C = 1."""
    array = np.ascontiguousarray(pixels[0].permute(1, 2, 0).numpy())
    height, width, channels = array.shape
    kind = "rgb8" if channels == 3 else f"mono{8 * array.itemsize}"
    layout = height, width, kind, 0, channels * array.itemsize * width
    return new("sensor_msgs/msg/Image", header(time, frame), *layout, array.reshape(-1).view(np.uint8))


def image_pixels(message: Any) -> torch.Tensor:
    """Pixels `[1, C, H, W]` uint8, C = 3 (RGB) or 1, of a `sensor_msgs/Image` or `CompressedImage`.

    Mosaics, YUV and 16 bits are converted.

    Raises:
        InputError: an encoding that is not read, or a size that does not fit the data.
    """
    if hasattr(message, "format"):
        decoded = cv2.imdecode(np.asarray(message.data), cv2.IMREAD_ANYCOLOR) if len(message.data) else None
        if decoded is None:
            raise InputError(f"an image that cannot be decoded ({message.format!r})")
        return torch.from_numpy(np.array(np.atleast_3d(decoded)[..., ::-1], np.uint8)).permute(2, 0, 1)[None]
    name = message.encoding.replace("16", "8")
    if name not in ENCODINGS:
        raise InputError(f"images of encoding {message.encoding!r} are not read; {', '.join(ENCODINGS)} are")
    channels, code = ENCODINGS[name]
    deep, height, step, data = name != message.encoding, message.height, message.step, np.asarray(message.data)
    row, rows = message.width * channels * (2 if deep else 1), height * 3 // 2 if name in PLANES else height
    if not 0 < row <= step or height < 1 or len(data) < rows * step:
        raise InputError(f"an image of {message.width}x{height} {message.encoding} cannot have {len(data)} bytes")
    array = data[: rows * step].reshape(rows, step)[:, :row].reshape(rows, message.width, -1)
    if deep:  # the upper byte of each number
        array = array[..., 0 if message.is_bigendian else 1 :: 2]
    if code is not None:
        array = np.atleast_3d(np.asarray(cv2.cvtColor(np.ascontiguousarray(array), code), np.uint8))
    return torch.from_numpy(np.array(array)).permute(2, 0, 1)[None]


MOSAICS = ("RGGB", "BGGR", "GBRG", "GRBG")
PLANES = ("nv12", "nv21")
"""Encodings with the rows of both colors below those of brightness."""

ENCODINGS = {
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "8UC3": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, None),
    "8UC1": (1, None),
    **{f"bayer_{order.lower()}8": (1, getattr(cv2, f"COLOR_Bayer{order}2RGB")) for order in MOSAICS},
    "yuv422": (2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2RGB_YUY2),
    "nv12": (1, cv2.COLOR_YUV2RGB_NV12),
    "nv21": (1, cv2.COLOR_YUV2RGB_NV21),
}
"""Encodings of images that are read, those of 16 bits as those of 8: bytes of a pixel, and conversion of OpenCV to red,
green, blue."""
