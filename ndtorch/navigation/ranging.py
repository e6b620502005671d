"""Ranges by triangulation from the places of one feature in both rows."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.navigation.correspondence import Matches
from ndtorch.navigation.rig import AngleModel, StereoRig


class Ranges(NamedTuple):
    """Ranged features, all `[..., n]`; slots that are not `valid` hold zeros.

    Attributes:
        left_range: distance from the left camera, m, [A eq. A.5].
        left_angle, right_angle: angles at the two cameras, radians, to the left positive.
        x, y: place in the body frame, m.
        valid: bool.
    """

    left_range: Tensor
    left_angle: Tensor
    right_angle: Tensor
    x: Tensor
    y: Tensor
    valid: Tensor


def triangulate(matches: Matches, rig: StereoRig, angles: AngleModel = "atan") -> Ranges:
    """`R_L = b cos(theta_R) / sin(theta_R - theta_L)` for every valid match. [A eq. A.3-A.5]

    Since a valid match has a positive disparity, its rays meet in front of the cameras: every range is
    positive and finite. With disparities 60 to 200 and b = 0.3 m, f = 430 the window straight ahead is
    0.65-2.15 m (2.37 m with the linear angles).
    """
    dtype = matches.error.dtype
    position = rig.pixel_position(torch.stack((matches.left, matches.right)).to(dtype))
    left, right = rig.angle(position, angles)
    valid = matches.valid & (right > left)
    # Slots without a match get angles that meet, so that neither values nor gradients there can be infinite.
    converging = (right - left).masked_fill(~valid, 1.0)
    distance = rig.baseline * right.cos() / converging.sin()
    x = rig.forward + distance * left.cos()
    y = rig.baseline / 2 + distance * left.sin()
    distance, left, right, x, y = torch.stack((distance, left, right, x, y)) * valid
    return Ranges(distance, left, right, x, y, valid)
