"""What a car sees, does and believes as standard ROS 2 messages, for recordings and live bridges alike.

Frames follow REP 105: `map` -> `odom` (what the localiser has corrected) -> `base_link`, the body frame of `StereoRig`:
x forward, y left. A message is an object of the definitions of `rosbags`, with the fields of its ROS type.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
import torch
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from ndtorch.errors import InputError
from ndtorch.navigation import Grid, Pose, Ranges, StereoRig
from ndtorch.navigation.mapping.map_files import FREE, OCCUPIED, PIXEL, ros_pixels
from ndtorch_robot.ports import DriveCommand

MAP, ODOM, BASE, CAMERAS = "map", "odom", "base_link", ("camera_left", "camera_right")

OK, WARN, ERROR = 0, 1, 2
"""Levels of a diagnostic status."""

BEAMS, HALF_ANGLE = 181, math.pi / 2
"""Beams of a scan, one a degree, and its angle to each side, radians."""

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


def definition(name: str) -> str:
    """The text of a type with all that it contains, as MCAP holds it."""
    return typestore().generate_msgdef(name, ros_version=2)[0]


def to_fields(message: Any) -> Any:
    """A message as dictionaries, lists and arrays, for a transport with classes of its own."""
    if hasattr(message, "__msgtype__"):
        return {name: to_fields(value) for name, value in vars(message).items() if name != "__msgtype__"}
    return [to_fields(part) for part in message] if isinstance(message, list) else message


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


def yaw(q: Any) -> float:
    """Heading of a quaternion, radians."""
    return math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))


def ros_pose(pose: Pose) -> Any:
    return new("geometry_msgs/msg/Pose", vector(pose.x, pose.y, name="Point"), quaternion(float(pose.heading)))


def twist(command: DriveCommand) -> Any:
    """`geometry_msgs/Twist`: speed and curvature as linear and angular velocity, m/s and rad/s."""
    return new("geometry_msgs/msg/Twist", vector(command.speed), vector(z=command.speed * command.curvature))


def twist_stamped(command: DriveCommand, time: float) -> Any:
    """`geometry_msgs/TwistStamped`."""
    return new("geometry_msgs/msg/TwistStamped", header(time, BASE), twist(command))


def laser_scan(ranges: Ranges, time: float) -> Any:
    """`sensor_msgs/LaserScan` of places `[n]` about the middle of the body: the nearest one in each degree.

    Beams without a place are NaN, "no measurement" of REP 117: nothing says that the path is free there.
    """
    valid = np.asarray(ranges.valid).reshape(-1)
    x, y = (np.asarray(part, np.float64).reshape(-1)[valid] for part in (ranges.x, ranges.y))
    step = 2 * HALF_ANGLE / (BEAMS - 1)
    beam = np.rint((np.arctan2(y, x) + HALF_ANGLE) / step).astype(int)
    seen = (beam >= 0) & (beam < BEAMS)
    found = np.full(BEAMS, np.nan, np.float32)
    np.fmin.at(found, beam[seen], np.hypot(x, y)[seen].astype(np.float32))
    angles, limits = (-HALF_ANGLE, HALF_ANGLE, step), (RANGE_MIN, RANGE_MAX)
    empty = np.zeros(0, np.float32)
    return new("sensor_msgs/msg/LaserScan", header(time, BASE), *angles, 0.0, 0.0, *limits, found, empty)


def odometry(pose: Pose, driven: DriveCommand, time: float) -> Any:
    """`nav_msgs/Odometry`: dead reckoning and the motion it was told. Covariances are zero: they are not known."""
    unknown = np.zeros(36)
    place = new("geometry_msgs/msg/PoseWithCovariance", ros_pose(pose), unknown)
    moved = new("geometry_msgs/msg/TwistWithCovariance", twist(driven), unknown)
    return new("nav_msgs/msg/Odometry", header(time, ODOM), BASE, place, moved)


def transforms(pose: Pose, place: Pose, time: float) -> Any:
    """`tf2_msgs/TFMessage`: `odom` -> `base_link` is dead reckoning, `map` -> `odom` brings the car to `place`."""
    turn = float(place.heading) - float(pose.heading)
    cos, sin, x, y = math.cos(turn), math.sin(turn), float(pose.x), float(pose.y)
    origin = Pose(float(place.x) - cos * x + sin * y, float(place.y) - sin * x - cos * y, turn)
    return new("tf2_msgs/msg/TFMessage", [transform(MAP, ODOM, origin, time), transform(ODOM, BASE, pose, time)])


def transform(parent: str, child: str, pose: Pose, time: float) -> Any:
    place = new("geometry_msgs/msg/Transform", vector(pose.x, pose.y), quaternion(float(pose.heading)))
    return new("geometry_msgs/msg/TransformStamped", header(time, parent), child, place)


def occupancy_grid(cells: torch.Tensor, grid: Grid, time: float, path: Sequence[tuple[float, float]] = ()) -> Any:
    """`nav_msgs/OccupancyGrid` of a map `[rows, columns]`, by the rule of `map.pgm`: 100, 0 along the path, or -1."""
    pixels = ros_pixels(cells, grid, np.array(path, np.float64).reshape(-1, 2))
    values = np.where(pixels == OCCUPIED, 100, np.where(pixels == FREE, 0, -1)).astype(np.int8)
    at, origin = header(time, MAP), ros_pose(Pose(grid.left, grid.bottom, 0.0))
    rows, columns = values.shape
    info = new("nav_msgs/msg/MapMetaData", at.stamp, grid.cell * PIXEL, columns, rows, origin)
    return new("nav_msgs/msg/OccupancyGrid", at, info, values.reshape(-1))


def diagnostics(standing: str | None, telemetry: Mapping[str, Any], time: float) -> Any:
    """`diagnostic_msgs/DiagnosticArray`: OK while the car drives, ERROR with the reason while it stands."""
    words = {
        key: value if isinstance(value, str) else json.dumps(value, default=str) for key, value in telemetry.items()
    }
    values = [new("diagnostic_msgs/msg/KeyValue", *item) for item in words.items()]
    level = OK if standing is None else ERROR
    status = new("diagnostic_msgs/msg/DiagnosticStatus", level, "ndtorch: car", standing or "drives", "", values)
    return new("diagnostic_msgs/msg/DiagnosticArray", header(time, BASE), [status])


def image(pixels: torch.Tensor, frame: str, time: float) -> Any:
    """`sensor_msgs/Image` of `[1, C, H, W]` uint8, C = 3 (RGB) or 1."""
    array = np.ascontiguousarray(pixels[0].permute(1, 2, 0).numpy())
    height, width, channels = array.shape
    kind = "rgb8" if channels == 3 else "mono8"
    layout = height, width, kind, 0, channels * width
    return new("sensor_msgs/msg/Image", header(time, frame), *layout, array.reshape(-1))


ENCODINGS = {
    "rgb8": (0, 1, 2),
    "bgr8": (2, 1, 0),
    "8UC3": (2, 1, 0),
    "rgba8": (0, 1, 2, 3),
    "bgra8": (2, 1, 0, 3),
    "mono8": (0,),
    "8UC1": (0,),
}
"""Encodings of images that are read, and where in a pixel red, green and blue stand."""


def image_pixels(message: Any) -> torch.Tensor:
    """Pixels `[1, C, H, W]` uint8, C = 3 (RGB) or 1, of a `sensor_msgs/Image`."""
    order = ENCODINGS.get(message.encoding)
    if order is None:
        raise InputError(f"images of encoding {message.encoding!r} are not read; {', '.join(ENCODINGS)} are")
    height, width, step, data = message.height, message.width, message.step, message.data
    row = width * len(order)
    if not 0 < row <= step or height < 1 or len(data) < height * step:
        raise InputError(f"an image of {width}x{height} {message.encoding} cannot have {len(data)} bytes")
    array = np.asarray(data)[: height * step].reshape(height, step)[:, :row].reshape(height, width, len(order))
    if order[:3] != (0, 1, 2)[: len(order[:3])] or len(order) == 4:
        array = array[..., list(order[:3])]
    return torch.from_numpy(np.array(array)).permute(2, 0, 1)[None]


def compressed_image(data: bytes, kind: str, frame: str, time: float) -> Any:
    """`sensor_msgs/CompressedImage` of the bytes of a file of `kind` "png" or "jpeg"."""
    return new("sensor_msgs/msg/CompressedImage", header(time, frame), kind, np.frombuffer(data, np.uint8))


def camera_infos(rig: StereoRig, time: float = 0.0) -> tuple[Any, Any]:
    """`sensor_msgs/CameraInfo` of the rectified pair; `StereoRig.from_projections` makes the rig of both `p` again."""
    found, (cx, cy), f = [], rig.center, rig.focal
    for side, frame in enumerate(CAMERAS):
        p = np.array([f, 0, cx, -f * rig.baseline * side, 0, f, cy, 0, 0, 0, 1, 0], np.float64)
        matrices = np.delete(p.reshape(3, 4), 3, 1).reshape(-1), np.eye(3).reshape(-1), p
        region = new("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        shape = rig.height, rig.width, "plumb_bob", np.zeros(5)
        found.append(new("sensor_msgs/msg/CameraInfo", header(time, frame), *shape, *matrices, 0, 0, region))
    return found[0], found[1]
