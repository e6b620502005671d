"""Log of ranges from which a map can be rendered again: each with its pose in a frame that may be moved later."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.navigation.odometry import Pose, to_world
from ndtorch.navigation.stereo.ranging import Ranges

COLUMNS = 8
"""Numbers of a logged range: five of `Ranges`, all but `valid`, and the pose in its frame."""

SQUARE_M = 0.15
"""Side of the squares in which ranges repeat each other."""

MAX_FRAME_RANGES = 2048
"""Ranges that are kept of a frame: those of some metres, as long as nothing was passed twice."""


class FramePose(NamedTuple):
    """A pose x, y, heading in the frame of a number."""

    frame: float
    pose: tuple[float, ...]


class Frames(NamedTuple):
    """Present poses of frames: their numbers, `[M]`, and their poses in the world, `[M, 3]`."""

    numbers: Tensor
    poses: Tensor


class RangeLog(NamedTuple):
    """Ranges by the frames that they were seen in, at most `MAX_FRAME_RANGES` of each that has ended.

    Attributes:
        numbers: of the frames that have ranges, `[K]`.
        ended: ranges in these, `[m, 8]` each.
        frame: number of the present one, `[]`.
        present: the last ranges in it, `[m, 8]`.
    """

    numbers: Tensor
    ended: tuple[Tensor, ...]
    frame: Tensor
    present: Tensor


def empty_log() -> RangeLog:
    """A log without ranges."""
    none = torch.zeros(0, dtype=torch.float64)
    return RangeLog(none, (), torch.tensor(-1.0, dtype=torch.float64), torch.zeros(0, COLUMNS))


def stays(frame: float) -> FramePose:
    """The frame itself, where frames never end in one another."""
    return FramePose(frame, (0.0, 0.0, 0.0))


def add_ranges(
    log: RangeLog, at: FramePose, ranges: Ranges, lasting: Callable[[float], FramePose | None] = stays
) -> RangeLog:
    """The log with the valid ones of the ranges `[n]` of one image pair.

    What a standing car sees counts once. The ended frames are shared with the log before, so that a step copies some
    hundred ranges only.

    Args:
        lasting: where a frame that has ended stands in one that lasts; None where it is gone.
    """
    before = float(log.frame)
    if before != at.frame:
        log = end_frame(log, lasting(before))._replace(frame=torch.tensor(at.frame, dtype=torch.float64))
    elif len(log.present) >= MAX_FRAME_RANGES:
        log = end_frame(log, stays(before))
    if not bool(ranges.valid.any()):
        return log
    found = torch.stack(ranges[:-1], -1)[ranges.valid].to(log.present)
    pose = found.new_tensor(at.pose).expand(len(found), 3)
    if len(log.present) and torch.equal(log.present[-1, 5:], pose[0]):
        return log
    return log._replace(present=torch.cat((log.present, torch.cat((found, pose), -1))))


def end_frame(log: RangeLog, home: FramePose | None) -> RangeLog:
    """The log with all ranges of the present frame in the frame in which it stands; without them if that is gone."""
    frame, rows, chunks = float(log.frame), log.present, dict(zip(log.numbers.tolist(), log.ended, strict=True))
    if home is None or home.frame != frame:
        rows = torch.cat((chunks.pop(frame, rows[:0]), rows))
    if home is not None and len(rows):
        if home.frame != frame:
            there = compose(torch.tensor(home.pose, dtype=torch.float64), rows[:, 5:])
            rows = torch.cat((rows[:, :5], torch.stack(there, -1).to(rows)), -1)
        chunks[home.frame] = thinned(torch.cat((chunks.get(home.frame, rows[:0]), rows)))
    numbers = torch.tensor(list(chunks), dtype=torch.float64)
    return log._replace(numbers=numbers, ended=tuple(chunks.values()), present=log.present[:0])


def thinned(rows: Tensor) -> Tensor:
    """At most `MAX_FRAME_RANGES` of the ranges of a frame, `[m, 8]`: of those that repeat each other the first ones."""
    if len(rows) <= MAX_FRAME_RANGES:
        return rows
    x, y, heading = rows[:, 5:].unbind(-1)
    ranks = repetitions(Pose(x, y, heading), rows[:, 3], rows[:, 4])
    limit = int(ranks.sort().values[MAX_FRAME_RANGES])
    if limit:
        return rows[ranks < limit]
    kept = torch.linspace(0, len(rows) - 1, MAX_FRAME_RANGES).long()
    return rows[kept]


def repetitions(poses: Pose, x: Tensor, y: Tensor) -> Tensor:
    """How many earlier ranges of the same place were seen from the same place, `[m]`: squares of `SQUARE_M`.

    Args:
        poses: `[m]`.
        x, y: what was ranged from them, in the body frame, m, `[m]`.
    """
    places = (poses.x, poses.y, *to_world(poses, x, y))
    squares = torch.stack([(part / SQUARE_M).floor().long() for part in places], -1)
    group = torch.unique(squares, dim=0, return_inverse=True)[1]
    order = group.argsort(stable=True)
    ordered = group[order]
    before = torch.empty_like(order)
    before[order] = torch.arange(len(order)) - torch.searchsorted(ordered, ordered)
    return before


def compose(base: Tensor, poses: Tensor) -> Pose:
    """Poses `[m, 3]` in frames at `base` `[..., 3]`, where these are known."""
    at, (x, y, heading) = Pose(*base.double().unbind(-1)), poses.double().unbind(-1)
    return Pose(*to_world(at, x, y), at.heading + heading)


def in_world(log: RangeLog, frames: Frames) -> tuple[Ranges, Pose]:
    """All ranges `[m, 1]` and the poses `[m]` in the world from which they were seen.

    Ranges in frames that are not among those given are left out.
    """
    where = dict(zip(frames.numbers.tolist(), frames.poses, strict=True))
    numbers = [*log.numbers.tolist(), float(log.frame)]
    chosen = [(rows, where[n]) for n, rows in zip(numbers, (*log.ended, log.present), strict=True) if n in where]
    rows = torch.cat([log.present[:0], *(part for part, _ in chosen)])
    base = torch.cat([torch.zeros(0, 3, dtype=torch.float64), *(pose.expand(len(part), 3) for part, pose in chosen)])
    distance, left, right, ahead, aside = (rows[:, None, part] for part in range(5))
    found = Ranges(distance, left, right, ahead, aside, torch.ones_like(distance, dtype=torch.bool))
    return found, Pose(*(part.to(rows) for part in compose(base, rows[:, 5:])))
