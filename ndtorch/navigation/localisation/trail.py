"""What was ranged and driven since the start, kept so that it can be gone through again.

What is seen first is placed with an odometer whose errors nobody knows yet, and all that is seen later is fitted to
it. Once the errors are known, the way since the start is gone through again with them, a scan a step, beside the
driving. When that has caught up, what it gave takes the place of the first.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ndtorch.navigation.localisation.params import RetraceParams
from ndtorch.navigation.localisation.state import Entry, Trail
from ndtorch.navigation.localisation.walls import Scan
from ndtorch.navigation.odometry import Pose


def no_trail() -> Trail:
    """Before anything was driven."""
    zero = torch.zeros((), dtype=torch.float64)
    return Trail((), zero, zero, zero, None, zero)


def driven_on(trail: Trail, length: float, seconds: float) -> Trail:
    """After a step of so many metres and seconds."""
    return trail._replace(way=trail.way + length, seconds=trail.seconds + seconds)


def with_scan(trail: Trail, scan: Scan, age: Tensor, reckoned: Pose, unsure: Tensor) -> Trail:
    """With one more entry."""
    points = torch.from_numpy(np.stack(scan, -1))
    entry = Entry(age, reckoned, trail.seconds, points, unsure)
    return trail._replace(entries=(*trail.entries, entry), seconds=torch.zeros_like(trail.seconds))


def scan_of(entry: Entry) -> Scan:
    """The scan of an entry."""
    x, y, weight = np.ascontiguousarray(entry.points.numpy().T)
    return Scan(x, y, weight)


def is_due(trail: Trail, params: RetraceParams) -> bool:
    """Whether it is time to begin again."""
    return float(trail.way) >= params.after[int(trail.times)]


def gone_through(trail: Trail, params: RetraceParams) -> Trail | None:
    """The trail after it was gone through; None after the last time."""
    times = trail.times + 1
    fresh = trail._replace(times=times, again=None, reached=torch.zeros_like(trail.reached))
    return fresh if int(times) < len(params.after) else None
