"""All numbers of the localiser."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.row_search import SearchParams


@dataclass(frozen=True)
class FindingParams:
    """How an unknown place is found in a known map.

    Args:
        way: driven before the first search, and from one to the next, m.
        again: driven until it is tried again where too little was ranged, m.
        around: what was ranged within this of the car is looked for, m.
        least: cells that this must be.
        pixel, blur: of the picture of the known walls, m.
        stride: places are tried so many pixels apart.
        turns: directions that are tried.
        each, kept: best places of a direction that are kept, and of all directions.
        loose: standard deviation of such a place, m and radians, from which it is refined.
        steps: of Gauss-Newton when it is refined.
        good: share of what was ranged that must fit.
        better: so much worse all other places must be.
        apart, turned: places farther apart than this, m or radians, are two.
    """

    way: float = 3.0
    again: float = 0.5
    around: float = 8.0
    least: int = 30
    pixel: float = 0.1
    blur: float = 0.12
    stride: int = 2
    turns: int = 90
    each: int = 2
    kept: int = 12
    loose: float = 0.3
    steps: int = 15
    good: float = 0.4
    better: float = 0.1
    apart: float = 0.5
    turned: float = math.radians(15.0)

    def __post_init__(self) -> None:
        check_numbers(self)
        for name, value in vars(self).items():
            if not value > 0:
                raise InputError(f"{name} must be a number > 0, got {value}")


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
        gain, first_gain, learning: share of a correction that goes into what is known of the odometry, its scale and
            its drift; at first `first_gain`, which falls to a half in `learning` scans.
        bent: from this turn between two scans on, radians, a correction of the heading is one of the turning.
        finding: how an unknown place is found in a known map.
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
    most: float = 1e5
    gate: float = 9.0
    steps: int = 8
    still: float = 0.002
    slip: float = 0.05
    turn_still: float = 0.0005
    turn_slip: float = 0.03
    turn_way: float = 0.01
    gain: float = 0.02
    first_gain: float = 0.2
    learning: float = 20.0
    bent: float = 0.03
    finding: FindingParams = field(default_factory=FindingParams)
    search: SearchParams = field(default_factory=SearchParams)

    def __post_init__(self) -> None:
        check_numbers(self)
        for name, value in vars(self).items():
            if name not in ("search", "finding", "gain", "settle") and not value > 0:
                raise InputError(f"{name} must be a number > 0, got {value}")
        if not (0 <= self.gain < 1 and self.settle >= 0 and self.near < self.far and self.size % 2 == 0):
            raise InputError(f"expected 0 <= gain < 1, settle >= 0, near < far and an even size, got {self}")
