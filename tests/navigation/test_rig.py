"""Pixels, angles and floor rectangles, against the published numbers and hand geometry."""

import math

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Rect, StereoRig


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


def test_project_agrees_with_angle():
    for pitch in (0.0, 0.2):
        rig = StereoRig(pitch=pitch)
        x, y = torch.tensor([2.0], dtype=torch.float64), torch.tensor([0.7], dtype=torch.float64)
        column, row = rig.project(x, y)
        assert float(rig.angle(rig.pixel_position(column))) == pytest.approx(math.atan2(0.7, 2.0))
        assert abs(float(row) - rig.row) <= 1


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


@pytest.mark.parametrize(
    "arguments", [{"baseline": 0}, {"focal": -1}, {"width": 4}, {"pitch": 1.5}, {"camera_height": math.nan}]
)
def test_bad_rigs(arguments):
    with pytest.raises(InputError):
        StereoRig(**arguments)


def test_bad_requests():
    rig = StereoRig()
    with pytest.raises(InputError, match="inside"):
        rig.subfields(near=0.2)
    with pytest.raises(InputError, match="near < far"):
        rig.subfields(near=2.0, far=1.0)
    with pytest.raises(InputError, match="angle model"):
        rig.angle(torch.zeros(1), "cubic")
