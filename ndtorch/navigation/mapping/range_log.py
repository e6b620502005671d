"""Log of ranges from which a map can be rendered again: each with its pose in a frame that may be moved later."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.stereo.ranging import Ranges

COLUMNS = 8
"""Numbers of a logged range: five of `Ranges`, all but `valid`, and the pose in its frame."""


class FramePose(NamedTuple):
    """A pose x, y, heading in the frame of a number."""

    frame: float
    pose: tuple[float, ...]


class Frames(NamedTuple):
    """Present poses of frames: their numbers, `[M]`, and their poses in the world, `[M, 3]`."""

    numbers: Tensor
    poses: Tensor


class RangeLog(NamedTuple):
    """All ranges, frame by frame in their order.

    Attributes:
        numbers: of the frames that have ended, `[K]`; a frame may come again.
        ended: ranges in these, `[m, 8]` each.
        frame: number of the present one, `[]`.
        present: ranges in it, `[m, 8]`.
    """

    numbers: Tensor
    ended: tuple[Tensor, ...]
    frame: Tensor
    present: Tensor


def empty_log() -> RangeLog:
    """A log without ranges."""
    none = torch.zeros(0, dtype=torch.float64)
    return RangeLog(none, (), torch.tensor(-1.0, dtype=torch.float64), torch.zeros(0, COLUMNS))


def add_ranges(log: RangeLog, at: FramePose, ranges: Ranges) -> RangeLog:
    """The log with the valid ones of the ranges `[n]` of one image pair.

    What a standing car sees counts once. The ended frames are shared with the log before, so that a step copies some
    hundred ranges only.
    """
    if float(log.frame) != at.frame:
        if len(log.present):
            numbers = torch.cat((log.numbers, log.frame[None]))
            log = log._replace(numbers=numbers, ended=(*log.ended, log.present), present=log.present[:0])
        log = log._replace(frame=torch.tensor(at.frame, dtype=torch.float64))
    if not bool(ranges.valid.any()):
        return log
    found = torch.stack(ranges[:-1], -1)[ranges.valid].to(log.present)
    pose = found.new_tensor(at.pose).expand(len(found), 3)
    if len(log.present) and torch.equal(log.present[-1, 5:], pose[0]):
        return log
    return log._replace(present=torch.cat((log.present, torch.cat((found, pose), -1))))


def in_world(log: RangeLog, frames: Frames) -> tuple[Ranges, Pose]:
    """All ranges `[m, 1]` and the poses `[m]` in the world from which they were seen.

    Ranges in frames that are not among those given are left out.
    """
    where = dict(zip(frames.numbers.tolist(), frames.poses, strict=True))
    numbers = [*log.numbers.tolist(), float(log.frame)]
    chosen = [(rows, where[n]) for n, rows in zip(numbers, (*log.ended, log.present), strict=True) if n in where]
    rows = torch.cat([log.present[:0], *(part for part, _ in chosen)])
    base = torch.cat([torch.zeros(0, 3, dtype=torch.float64), *(pose.expand(len(part), 3) for part, pose in chosen)])
    x, y, heading = rows[:, 5:].double().unbind(-1)
    cos, sin = base[:, 2].cos(), base[:, 2].sin()
    poses = base[:, 0] + cos * x - sin * y, base[:, 1] + sin * x + cos * y, base[:, 2] + heading
    distance, left, right, ahead, aside = (rows[:, None, part] for part in range(5))
    found = Ranges(distance, left, right, ahead, aside, torch.ones_like(distance, dtype=torch.bool))
    return found, Pose(*(part.to(rows) for part in poses))
