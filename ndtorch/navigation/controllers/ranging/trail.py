"""The trail: where the car has just driven, and how it goes back there. What its body swept then was free."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.kernels.trail import AHEAD, ASIDE, HERE, NEAREST, POSES, SPACING, TURNED
from ndtorch.navigation.odometry import Pose


class Trail(NamedTuple):
    """Poses that the car has driven through forward, by dead reckoning.

    Attributes:
        places: x, y in m and heading, the newest first, `[..., POSES, 3]`.
        number: how many of them count, `[...]`.
    """

    places: Tensor
    number: Tensor


def empty_trail(pose: Pose) -> Trail:
    """Of a car that has not driven yet."""
    return Trail(pose.x.new_zeros(*pose.x.shape, POSES, 3), torch.zeros_like(pose.x))


def seen_from(pose: Pose, place: Tensor) -> tuple[Tensor, Tensor]:
    """Poses `[..., 3]` in the body frame, x and y."""
    cos, sin = pose.heading.cos(), pose.heading.sin()
    dx, dy = place[..., 0] - pose.x, place[..., 1] - pose.y
    return cos * dx + sin * dy, cos * dy - sin * dx


def lay(trail: Trail, pose: Pose, speed: Tensor) -> Trail:
    """The trail after a step: forward it grows, and going back takes off what is passed.

    A car that goes back beside it has left the trail, and begins another one there.

    Args:
        pose: where the car is, `[...]`.
        speed: at which it came there, m/s.
    """
    places, count = trail
    last = places[..., 0, :]
    x, y = seen_from(pose, last)
    first = count < 1
    aside = (y.abs() > ASIDE) | ((last[..., 2] - pose.heading).abs() > TURNED)
    off = ~first & (speed < -1e-3) & aside
    passed = ~first & ~off & (speed <= 0) & (x > -HERE)
    far = ~first & (speed > 0) & (torch.hypot(x, y) >= SPACING)
    longer = torch.cat((torch.stack(pose, -1).unsqueeze(-2), places[..., :-1, :]), -2)
    shorter = torch.cat((places[..., 1:, :], places[..., -1:, :]), -2)
    grows, shrinks = ((first | off | far)[..., None, None], passed[..., None, None])
    places = torch.where(grows, longer, torch.where(shrinks, shorter, places))
    length = (count + far.to(count.dtype) - passed.to(count.dtype)).clamp(max=POSES)
    return Trail(places, torch.where(first | off, torch.ones_like(count), length))


def back(trail: Trail, pose: Pose, tightest: Tensor) -> tuple[Tensor, Tensor]:
    """How far the trail leads back, m, and the curvature that follows it: the arc to a place 0.2 m behind (pure
    pursuit [Coulter 1992]).

    Args:
        tightest: largest curvature, 1/m.
    """
    behind = (trail.number - 1).clamp(min=0)
    at = behind.clamp(max=AHEAD).long()[..., None, None]
    x, y = seen_from(pose, trail.places.gather(-2, at.expand(*at.shape[:-1], 3)).squeeze(-2))
    bend = (2 * y / (x.square() + y.square()).clamp(min=NEAREST)).clamp(-tightest, tightest)
    return behind * SPACING, torch.where(x < -2 * HERE, bend, torch.zeros_like(bend))
