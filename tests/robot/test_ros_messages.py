"""Messages of ROS 2, read by a decoder of somebody else from the definitions that recordings hold."""

import math

import numpy as np
import pytest
import torch
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_typestore

from ndtorch.navigation import Grid, Pose, StereoRig
from ndtorch_robot import ros_messages as ros


def read_again(message):
    """Bytes of ours, decoded by `mcap-ros2-support`, which parses the text of a definition."""
    name = message.__msgtype__
    text = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(name, ros_version=2)[0]
    decode = DecoderFactory().decoder_for("cdr", Schema(1, text.encode(), "ros2msg", name))
    assert decode is not None
    return decode(ros.to_cdr(message))


def test_transforms_lead_to_the_place_in_the_map():
    """`map` -> `odom` -> `base_link`, one after the other, is where the localiser has the car."""
    place = Pose(3.0, 4.0, 0.7)
    outer, inner = read_again(ros.transforms(Pose(1.0, -2.0, -0.4), place, 0.0)).transforms
    assert (outer.header.frame_id, outer.child_frame_id) == ("map", inner.header.frame_id)
    turn, at, by = ros.yaw(outer.transform.rotation), outer.transform.translation, inner.transform.translation
    x = at.x + math.cos(turn) * by.x - math.sin(turn) * by.y
    y = at.y + math.sin(turn) * by.x + math.cos(turn) * by.y
    assert (x, y, turn + ros.yaw(inner.transform.rotation)) == pytest.approx(tuple(place))


def test_a_map_of_what_is_occupied_and_free():
    """5 cm a pixel: a cell of 1 cm fills its pixel, a faint one does not, and the body was where the path is."""
    grid, cells = Grid(-1.0, 1.0, 0.0, 0.5, cell=0.01), torch.zeros(50, 200)
    cells[22, 151], cells[40, 10], cells[40, 100] = 1.0, 0.01, 0.5
    found = read_again(ros.occupancy_grid(cells, grid, 0.0, [(-0.9, 0.02)]))
    assert (found.info.width, found.info.height, found.info.resolution) == (40, 10, pytest.approx(0.05))
    assert (found.info.origin.position.x, found.info.origin.position.y) == (-1.0, 0.0)
    data = np.array(found.data).reshape(10, 40)
    assert np.argwhere(data == 100).tolist() == [[4, 30], [8, 20]]
    free = np.argwhere(data == 0) * 0.05 + (0.025, 0.025 - 1.0)
    assert len(free) > 10
    assert np.hypot(*(free - (0.02, -0.9)).T).max() < 0.25
    assert set(data.ravel()) == {-1, 0, 100}


def test_calibration_makes_the_rig_again():
    rig = StereoRig(baseline=0.11, focal=436.2, width=752, height=480, cx=364.4, cy=240.1)
    left, right = map(read_again, ros.camera_infos(rig))
    assert StereoRig.from_projections(left.p, right.p, left.width, left.height) == rig


def test_images_and_fields():
    message = ros.compressed_image(b"\x89PNG", "png", "camera_left", 1.5)
    assert bytes(read_again(message).data) == b"\x89PNG"
    fields = ros.to_fields(message)
    assert fields["header"] == {"stamp": {"sec": 1, "nanosec": 500_000_000}, "frame_id": "camera_left"}
    assert ros.to_cdr(ros.from_cdr(ros.to_cdr(message), "sensor_msgs/msg/CompressedImage")) == ros.to_cdr(message)
