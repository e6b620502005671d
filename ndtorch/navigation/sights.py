"""What a map is drawn from: every range with the pose it was seen from, in a frame that may be moved later."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.ranging import Ranges

LENGTH = 8
"""Numbers of a sight: five of `Ranges`, all but `valid`, and the pose in its frame."""


class Anchor(NamedTuple):
    """A pose in a frame.

    Attributes:
        frame: number of the frame.
        pose: x, y and heading in it.
    """

    frame: float
    pose: tuple[float, float, float]


class Frames(NamedTuple):
    """Where frames are now: their numbers, `[M]`, and their poses in the world, `[M, 3]`."""

    numbers: Tensor
    poses: Tensor


class Sights(NamedTuple):
    """All sights, frame by frame as they came.

    Attributes:
        numbers: of the frames that are over, `[K]`; a frame may come again.
        seen: sights in these, `[m, 8]` each.
        frame: the number of the present one, `[]`.
        now: sights in that, `[m, 8]`.
    """

    numbers: Tensor
    seen: tuple[Tensor, ...]
    frame: Tensor
    now: Tensor


def no_sights() -> Sights:
    """Before anything was seen."""
    none = torch.zeros(0, dtype=torch.float64)
    return Sights(none, (), torch.tensor(-1.0, dtype=torch.float64), torch.zeros(0, LENGTH))


def add_sights(sights: Sights, anchor: Anchor, ranges: Ranges) -> Sights:
    """With the valid ones of the ranges `[n]` of a frame of the cameras.

    What a car sees while it stands counts once. What is over is shared with the sights before, and what is added to is
    one frame's, some hundred sights.
    """
    if float(sights.frame) != anchor.frame:
        if len(sights.now):
            numbers = torch.cat((sights.numbers, sights.frame[None]))
            sights = sights._replace(numbers=numbers, seen=(*sights.seen, sights.now), now=sights.now[:0])
        sights = sights._replace(frame=torch.tensor(anchor.frame, dtype=torch.float64))
    if not bool(ranges.valid.any()):
        return sights
    found = torch.stack(ranges[:-1], -1)[ranges.valid].to(sights.now)
    pose = found.new_tensor(anchor.pose).expand(len(found), 3)
    if len(sights.now) and torch.equal(sights.now[-1, 5:], pose[0]):
        return sights
    return sights._replace(now=torch.cat((sights.now, torch.cat((found, pose), -1))))


def placed_sights(sights: Sights, frames: Frames) -> tuple[Ranges, Pose]:
    """All sights as ranges `[m, 1]` and the poses `[m]` of the world they were seen from.

    Sights in frames that are not among those given, which have been forgotten, are left out.
    """
    where = dict(zip(frames.numbers.tolist(), frames.poses, strict=True))
    numbers = [*sights.numbers.tolist(), float(sights.frame)]
    chosen = [(seen, where[n]) for n, seen in zip(numbers, (*sights.seen, sights.now), strict=True) if n in where]
    seen = torch.cat([sights.now[:0], *(part for part, _ in chosen)])
    base = torch.cat([torch.zeros(0, 3, dtype=torch.float64), *(pose.expand(len(part), 3) for part, pose in chosen)])
    x, y, heading = seen[:, 5:].double().unbind(-1)
    cos, sin = base[:, 2].cos(), base[:, 2].sin()
    poses = base[:, 0] + cos * x - sin * y, base[:, 1] + sin * x + cos * y, base[:, 2] + heading
    distance, left, right, ahead, aside = (seen[:, None, part] for part in range(5))
    found = Ranges(distance, left, right, ahead, aside, torch.ones_like(distance, dtype=torch.bool))
    return found, Pose(*(part.to(seen) for part in poses))
