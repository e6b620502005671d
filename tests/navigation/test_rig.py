"""Pixels, angles and floor rectangles, against the published numbers and hand geometry."""

import math
from dataclasses import replace

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Navigator, Rect, StereoRanging, StereoRig


def test_published_linear_angle():
    """A3: 0.1212 degrees a pixel, 0.875 degrees root mean square error."""
    rig = StereoRig()
    assert math.degrees(rig.pixel_angle) == pytest.approx(0.1212, abs=5e-5)
    p = rig.pixel_position(torch.arange(640, dtype=torch.float64))
    error = rig.angle(p, "linear") - rig.angle(p, "atan")
    assert math.degrees(float(error.square().mean().sqrt())) == pytest.approx(0.875, rel=0.01)


def test_field_of_view_and_signs():
    rig = StereoRig()
    angle = rig.angle(rig.pixel_position(torch.tensor([0.0, 319.5, 639.0], dtype=torch.float64)))
    assert math.degrees(float(angle[0] - angle[2])) == pytest.approx(73.3, abs=0.5)
    assert angle[0] > 0  # the left border looks left
    assert angle[1] == 0
    assert rig.row == 240


def test_subfields_of_the_default_floor():
    """Rows 86.0 to 57.3 below the middle, columns 30.1 to 115.2 outward of it."""
    left, right = StereoRig().subfields()
    assert left == Rect(297, 326, 205, 290)
    assert right == Rect(297, 326, 350, 435)
    assert left.left == 640 - right.right


def test_subfields_see_the_floor_asked_for():
    rig = StereoRig(pitch=0.1, camera_height=0.3, focal=500.0)
    left, _ = rig.subfields(0.9, 1.4, math.radians(3), math.radians(10))
    # The ray through the middle of the rectangle, intersected with the floor.
    column, row = (left.left + left.right - 1) / 2, (left.top + left.bottom - 1) / 2
    right_of, below = (column - 319.5) / 500, (row - 239.5) / 500
    forward = math.cos(0.1) - below * math.sin(0.1)
    down = math.sin(0.1) + below * math.cos(0.1)
    ahead = 0.3 / down * forward
    assert 0.9 < ahead < 1.4
    assert math.radians(3) < math.atan2(-right_of * 0.3 / down, ahead) < math.radians(10)


KITTI = (
    [[721.54, 0, 609.56, 44.857], [0, 721.54, 172.85, 0.216], [0, 0, 1, 0.0027]],
    [[721.54, 0, 609.56, -339.52], [0, 721.54, 172.85, 2.200], [0, 0, 1, 0.0027]],
)


def test_projection_matrices_of_kitti_and_opencv():
    rig = StereoRig.from_projections(*KITTI, 1242, 375, camera_height=1.65)
    assert rig.baseline == pytest.approx(0.5327, abs=1e-4)
    assert (rig.focal, rig.cx, rig.cy, rig.row, rig.camera_height) == (721.54, 609.56, 172.85, 173, 1.65)
    p = torch.tensor([[430.0, 0, 300, 0], [0, 430, 250, 0], [0, 0, 1, 0]], dtype=torch.float64)
    q = p.clone()
    q[0, 3] = -430 * 0.3
    made = StereoRig.from_projections(p, q.numpy(), 640, 480)
    assert made.baseline == pytest.approx(0.3)
    assert made.center == (300, 250)
    other = q.clone()
    other[0, 2] = 310
    for left, right in ((q, p), (p, other), (p[:2], q), (p * float("nan"), q)):
        with pytest.raises(InputError):
            StereoRig.from_projections(left, right, 640, 480)
    for left, right in ((torch.eye(4), q), (p, torch.eye(4)), (torch.eye(3), q)):
        with pytest.raises(InputError, match="3 x 4"):
            StereoRig.from_projections(left, right, 640, 480)
    for values in ({"cx": 700.0}, {"cy": -1.0}):
        with pytest.raises(InputError, match="inside the frame"):
            StereoRig(**values)


def test_rigs_of_others() -> None:
    """Axes between two pixels; and a rig that shows no floor near the car says what to change."""
    euroc = StereoRig(0.11, 436.24, 752, 480, camera_height=0.2, cx=364.44)
    ours, theirs = euroc.subfields()
    assert ours.right - ours.left == theirs.right - theirs.left
    assert abs((ours.left + theirs.right - 1) / 2 - euroc.center[0]) <= 1
    Navigator(euroc, 0.05, controller="published")
    kitti = StereoRig(0.537, 707.09, 1241, 376, camera_height=1.65, cx=601.89, cy=183.11)
    with pytest.raises(InputError, match=r"in view is 6\.08 m ahead: mount the cameras at most 0\.18 m high"):
        Navigator(kitti, 0.1)
    lower = replace(kitti, camera_height=0.17)
    assert lower.floor_from < 0.65
    StereoRanging(kitti, 0.1)
