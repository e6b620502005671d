"""All numbers of the localiser."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ndtorch.errors import InputError
from ndtorch.navigation.row_search import SearchParams


@dataclass(frozen=True)
class LocaliserParams:
    """How the car finds out where it is.

    Args:
        every: time between two scans, s.
        settle: what is seen in this time from the start is taken as it is, s.
        near, far: ranges of a scan that count, m.
        full: up to this range they count 1, beyond it less by the square of the range, m.
        cell: side of the cells that gather what was ranged, m; [Biber & Straßer 2003] take 1 m for a laser.
        size: cells along the side of the square around the origin.
        blur: standard deviation that is added to each cell's distribution, m.
        least, most: weight that a cell must have to count, and the largest it can have.
        gate: squared distance, in standard deviations, at which a point counts a quarter.
        steps: of Gauss-Newton, at most.
        still, slip, turn_still, turn_slip, turn_way: standard deviations of dead reckoning between two scans: of the
            place, m and m each metre, and of the heading, radians, radians each radian turned and each metre.
        gain: share of a correction that goes into what is known of the odometry: its scale and its drift.
        search: how the right row is searched for ranges.

    Raises:
        InputError: a number that is not positive.
    """

    every: float = 0.2
    settle: float = 1.0
    near: float = 0.9
    far: float = 6.5
    full: float = 2.5
    cell: float = 0.25
    size: int = 256
    blur: float = 0.02
    least: float = 1.5
    most: float = 400.0
    gate: float = 9.0
    steps: int = 8
    still: float = 0.002
    slip: float = 0.05
    turn_still: float = 0.0005
    turn_slip: float = 0.05
    turn_way: float = 0.01
    gain: float = 0.02
    search: SearchParams = field(default_factory=SearchParams)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name not in ("search", "gain", "settle") and not 0 < value < math.inf:
                raise InputError(f"{name} must be a number > 0, got {value}")
        if not (0 <= self.gain < 1 and self.settle >= 0 and self.near < self.far and self.size % 2 == 0):
            raise InputError(f"expected 0 <= gain < 1, settle >= 0, near < far and an even size, got {self}")
