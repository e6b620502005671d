"""Small recordings of random steps, recordings written anew with other content, and messages of a stereo camera."""

import json

import numpy as np
import torch
from mcap.reader import make_reader
from mcap.writer import Writer

from ndtorch.navigation import StereoRig, Strips
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.ports import DriveCommand, Step, StereoFrames
from ndtorch_robot.recording import Recorder

RIG = StereoRig(width=64, height=48, focal=43.0)
STILL = DriveCommand(0.0, 0.0)


def eye(n, channels=3, height=48, width=64):
    shape = (1, channels, height, width)
    return torch.randint(0, 256, shape, generator=torch.Generator().manual_seed(n), dtype=torch.uint8)


def frames(n, strips=False, channels=3):
    if strips:
        left, right = (Strips(eye(4 * n + k, channels, 9, 21), eye(4 * n + k + 1, channels, 1)) for k in (0, 2))
        return StereoFrames(left, right, n / 30)
    return StereoFrames(eye(2 * n, channels), eye(2 * n + 1, channels), n / 30)


def step(n, seen=None, **changed):
    seen = frames(n) if seen is None else seen
    return Step(n, n / 30, seen, DriveCommand(0.1 * n, -0.3), DriveCommand(0.5, 1 / 3), STILL)._replace(**changed)


def write(path, count=5, strips=False, channels=3, **options):
    with Recorder(path, **({"when_full": "wait"} | options)) as recorder:
        for n in range(count):
            recorder(step(n, frames(n, strips, channels)))
    return recorder


def same(a, b):
    if isinstance(a, Strips):
        return all(torch.equal(one.sum(1), other.sum(1)) for one, other in zip(a, b, strict=True))
    return torch.equal(a, b)


def rewrite(path, edit, header=None):
    """Write a recording anew, every checksum right.

    Args:
        edit: `(topic, step, data) -> data`, None to leave the message out.
        header: changes the metadata at the beginning.
    """
    with path.open("rb") as file:
        reader = make_reader(file)
        metadata, found = list(reader.iter_metadata()), list(reader.iter_messages(log_time_order=False))
    with path.open("wb") as file:
        writer, channels = Writer(file, chunk_size=1 << 30), {}
        writer.start("ros2")
        writer.add_metadata(metadata[0].name, metadata[0].metadata | (header or {}))
        for schema, channel, message in found:
            data = edit(channel.topic, message.sequence, message.data)
            if data is None:
                continue
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
            at = message.log_time
            writer.add_message(channels[channel.topic], at, data, at, message.sequence)
        writer.flush()
        for record in metadata[1:]:
            writer.add_metadata(record.name, record.metadata)
        writer.finish()


def edited(data, change):
    """The message of a step with other values."""
    values = json.loads(ros.from_cdr(data, "std_msgs/msg/String").data)
    return ros.to_cdr(ros.new("std_msgs/msg/String", json.dumps(change(values))))


def camera_infos(rig, distortion=(0.0,) * 5):
    """`sensor_msgs/CameraInfo` of both cameras of a rig."""
    (cx, cy), f, infos = rig.center, rig.focal, []
    for side in (0, 1):
        p = np.array([f, 0, cx, -f * rig.baseline * side, 0, f, cy, 0, 0, 0, 1, 0], np.float64)
        matrices = np.delete(p.reshape(3, 4), 3, 1).reshape(-1), np.eye(3).reshape(-1), p
        region = ros.new("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        shape = rig.height, rig.width, "plumb_bob", np.array(distortion)
        infos.append(ros.new("sensor_msgs/msg/CameraInfo", ros.header(0.0, "camera"), *shape, *matrices, 0, 0, region))
    return infos
