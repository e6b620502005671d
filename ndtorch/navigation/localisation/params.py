"""All numbers of the localiser."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

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
class PartParams:
    """How the building is gathered in parts that can be moved.

    Args:
        way, longest: length of a part, m, and of one that has less than `ripe` cells by then.
        size: cells along the side of its square.
        least: cells that it must have, and that two parts must share to be fitted.
        coarse: side of the squares by which it is told what they share, m.
        seen, known, gap: a part is left out where this share of it was seen by so many parts before, unless the last
            one that was kept ended so far before, m.
        most: parts that a new one is fitted to, those with the largest share of their cells in common first.
        count: parts at most; then the building is taken as known.
        points: ranges of a part that are fitted to others, at most.
        reach: two parts are fitted from where the graph has them, with standard deviations so many times as large as
            it says; the fit begins so far to all sides, too.
        loose, turned, steps: these standard deviations at most, m and radians, and steps of Gauss-Newton.
        unlikely: squared distance, in standard deviations, of a fit from there, beyond which it is not believed.
        good: share of the one that must fit the other.
        apart, better: fits farther apart than this are two, m, and so much worse all but the best must be.
        trust: factor of what a fit says, whose points are not independent.
        learning: what was seen in this time from the start, s, counts only where nothing was seen later; until the way
            since the start was gone through again, see `RetraceParams`.
        still, slip, turn_still, turn_way, turn_slip: standard deviations of dead reckoning along a part, m, and m
            each metre; radians, radians each metre, and radians each radian turned.
        gate: squared distance, in standard deviations, at which an edge of the graph counts a quarter.
        rounds: of Gauss-Newton in the graph, after each part.
        moved, by, many: a fit waits that would move so many parts before the newest by more than this, as squared
            distance in standard deviations of their place, and in m.
        same: squared distance, in standard deviations, of a fit of another part from what the first one says, up to
            which it says the same, so that both count.
        patience: parts that are finished until a fit that waits is given up.
    """

    way: float = 2.0
    longest: float = 6.0
    size: int = 72
    ripe: int = 12
    least: int = 5
    coarse: float = 0.5
    seen: int = 3
    known: float = 0.9
    gap: float = 8.0
    most: int = 10
    count: int = 150
    points: int = 100
    reach: float = 3.0
    loose: float = 0.3
    turned: float = 0.1
    unlikely: float = 16.0
    steps: int = 10
    good: float = 0.3
    apart: float = 0.1
    better: float = 0.05
    trust: float = 0.1
    learning: float = 1.0
    still: float = 0.01
    slip: float = 0.003
    turn_still: float = 0.002
    turn_way: float = 0.0003
    turn_slip: float = 0.001
    gate: float = 16.0
    rounds: int = 2
    moved: float = 9.0
    by: float = 0.05
    many: int = 5
    same: float = 9.0
    patience: int = 30

    def __post_init__(self) -> None:
        check_numbers(self)
        for name, value in vars(self).items():
            if not value > 0:
                raise InputError(f"{name} must be a number > 0, got {value}")


@dataclass(frozen=True)
class RetraceParams:
    """When the way since the start is gone through again, with what is known of the odometer by then.

    Args:
        after: driven before each time, m, growing; empty for never.
        widen: factor of the standard deviations of what is known then: they are too small, since what was seen was
            fitted to what was placed wrongly itself.
    """

    after: tuple[float, ...] = (57.0, 115.0)
    widen: float = 4.0

    def __post_init__(self) -> None:
        check_numbers(self)
        if not self.widen > 0:
            raise InputError(f"widen must be a number > 0, got {self.widen}")
        if not all(before < after for before, after in pairwise((0.0, *self.after))):
            raise InputError(f"after must be ways > 0 that grow, got {self.after}")


@dataclass(frozen=True)
class MotionParams:
    """How way and turn between two looks are seen, and weighed against what the wheels say.

    Args:
        half: pixels compared to either side of a place.
        reach: pixels that it may be off.
        max_difference: mean difference of a match at most, for intensities 0..1.
        ratio: a match must differ by less than this share of the best one elsewhere.
        least: places in either row that must be found again.
        pixel, disparity: standard deviations of where a place is found, and of its disparity, pixels.
        gate: squared distance, in standard deviations, at which a place counts a quarter.
        worst: mean of these squares at most, of places within the gate.
        agree: share of the places found that these must be.
        steps: of Gauss-Newton.
        floor, turn_floor: standard deviations of what is seen at best, m and radians.
        scale, bend, drift: standard deviations of the wheels' errors before anything is known of them: share of way and
            turn, share of turn, and radians a second.
        scale_walk, bend_walk, drift_walk: by which they change from look to look.
        slip, still, turn_slip, turn_still: standard deviations of the wheels between two looks, m each metre and m, and
            radians each radian turned and radians.
        surprise: squared distance, in standard deviations, of what is seen from what the wheels say, beyond which they
            have slipped.
    """

    half: int = 8
    reach: int = 24
    max_difference: float = 0.05
    ratio: float = 0.8
    least: int = 5
    pixel: float = 0.39
    disparity: float = 0.3
    gate: float = 6.0
    worst: float = 0.8
    agree: float = 0.85
    steps: int = 6
    floor: float = 0.001
    turn_floor: float = 0.0001
    scale: float = 0.1
    bend: float = 0.03
    drift: float = math.radians(0.2)
    scale_walk: float = 0.01
    bend_walk: float = 2e-4
    drift_walk: float = math.radians(0.001)
    slip: float = 0.02
    still: float = 1e-4
    turn_slip: float = 0.02
    turn_still: float = 0.001
    surprise: float = 9.0

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
        still, turn_still: standard deviations of dead reckoning between two scans, m and radians, beside those of
            `motion`.
        scale, bend, drift: standard deviations of the errors of what `motion` makes of the odometer, before anything is
            known of them.
        scale_walk, bend_walk, drift_walk: by which they change from scan to scan.
        left: factor of these six, and limit of what the first three grow to, once seen motion has told the errors of
            the odometer: what a fit is off by then is the fit's own error, or the pose's.
        trust: factor of what a fit says, whose points are not independent.
        floor, turn_floor: standard deviations of a fit at best, m and radians.
        reach: a fit begins with standard deviations so many times those of the pose.
        worst: a fit that is worse counts nothing.
        surprise: squared distance, in standard deviations, of a fit from the pose expected, beyond which the wheels
            have slipped.
        finding: how an unknown place is found in a known map.
        search: how the right row is searched for ranges.
        motion: how the way between two scans is seen.
        parts: how what was ranged is gathered in parts that can be moved.
        retrace: when the way since the start is gone through again.

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
    still: float = 0.001
    turn_still: float = 0.0003
    scale: float = 0.003
    bend: float = 0.003
    drift: float = math.radians(0.005)
    scale_walk: float = 5e-5
    bend_walk: float = 5e-5
    drift_walk: float = math.radians(0.0003)
    left: float = 0.1
    trust: float = 0.05
    floor: float = 0.01
    turn_floor: float = 0.006
    reach: float = 3.0
    worst: float = 0.1
    surprise: float = 16.0
    finding: FindingParams = field(default_factory=FindingParams)
    search: SearchParams = field(default_factory=lambda: SearchParams(count=32, min_disparity=8))
    motion: MotionParams = field(default_factory=MotionParams)
    parts: PartParams = field(default_factory=PartParams)
    retrace: RetraceParams = field(default_factory=RetraceParams)

    def __post_init__(self) -> None:
        check_numbers(self)
        for name, value in vars(self).items():
            if name not in ("search", "finding", "motion", "parts", "retrace", "settle") and not value > 0:
                raise InputError(f"{name} must be a number > 0, got {value}")
        if not (self.settle >= 0 and self.near < self.far and self.size % 2 == 0):
            raise InputError(f"expected settle >= 0, near < far and an even size, got {self}")

    @property
    def reach_of_walls(self) -> float:
        """How far from the origin walls are gathered, along x and y, m."""
        return self.size // 2 * self.cell
