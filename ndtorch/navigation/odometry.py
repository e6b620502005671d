"""Dead reckoning: where the car is, from the speed and curvature it drove."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_number, check_state, check_tensor
from ndtorch.errors import InputError


class Pose(NamedTuple):
    """`x`, `y` in m and `heading` in radians, counter-clockwise from x: tensors of one shape `[...]`, or numbers."""

    x: Any
    y: Any
    heading: Any


def arc(pose: Pose, speed: Any, curvature: Any, dt: float) -> Pose:
    """The pose after `dt` seconds at constant speed and curvature: the exact arc, of tensors or of numbers.

    Front and rear wheels counter-steer by equal angles, so the middle of the body moves the way the body
    points and the arc is that of its middle: chord `2 sin(k s / 2) / k` in the direction half way through.
    """
    length = speed * dt
    half = curvature * length / 2
    direction = pose.heading + half
    if isinstance(direction, Tensor):
        chord = length * torch.sinc(half / math.pi)
        return Pose(pose.x + chord * direction.cos(), pose.y + chord * direction.sin(), direction + half)
    chord = length * (math.sin(half) / half if half else 1.0)
    return Pose(pose.x + chord * math.cos(direction), pose.y + chord * math.sin(direction), direction + half)


class DeadReckoning(nn.Module):
    """Poses from driven speeds and curvatures. [A §2.2, Methods]

    Shapes:
        speed m/s and curvature 1/m, `[..., T]` -> `Pose` of `[..., T]`: where the car is after having driven
        each of them for `dt`. State: `Pose` of `[...]`; `None` starts at the origin, heading along x.

    Args:
        dt: time step, s.

    Raises:
        InputError: dt not positive, or speed and curvature of different shapes, without time, or not finite.

    >>> path, state = DeadReckoning(dt=0.5)(torch.ones(4), torch.zeros(4))
    >>> path.x
    tensor([0.5000, 1.0000, 1.5000, 2.0000])
    """

    def __init__(self, dt: float) -> None:
        super().__init__()
        check_number("dt", dt, above=0, unit="seconds")
        self.dt = dt

    def forward(self, speed: Tensor, curvature: Tensor, state: Pose | None = None) -> tuple[Pose, Pose]:
        check_state(state, Pose)
        check_tensor("speed", speed)
        check_tensor("curvature", curvature)
        if speed.shape != curvature.shape or speed.ndim < 1 or speed.shape[-1] == 0:
            raise InputError(
                f"speed and curvature must be of one shape [..., T >= 1], "
                f"got {tuple(speed.shape)} and {tuple(curvature.shape)}"
            )
        zero = torch.zeros_like(speed[..., 0])
        pose = Pose(zero, zero, zero) if state is None else state
        poses = []
        for v, k in zip(speed.unbind(-1), curvature.unbind(-1), strict=True):
            pose = self.step(pose, v, k)
            poses.append(pose)
        x, y, heading = (torch.stack(parts, -1) for parts in zip(*poses, strict=True))
        return Pose(x, y, heading), pose

    def step(self, pose: Pose, speed: Any, curvature: Any) -> Pose:
        return arc(pose, speed, curvature, self.dt)


def to_world(pose: Pose, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
    """Points of the body frame in the world; pose and points broadcast."""
    cos, sin = pose.heading.cos(), pose.heading.sin()
    return pose.x + cos * x - sin * y, pose.y + sin * x + cos * y
