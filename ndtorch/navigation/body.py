"""The body of a robot, from which the lengths of everything that drives it follow."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ndtorch.arguments import check_numbers
from ndtorch.navigation.proximity.params import ProximityParams
from ndtorch.navigation.stereo.correspondence import MatchParams
from ndtorch.navigation.stereo.rig import StereoRig
from ndtorch.navigation.stereo.search import SearchParams

USUAL_FOCAL_BASELINE = 129.0
"""Pixels times metres of the rig of [A], for which the disparities of `MatchParams` and `SearchParams` are."""

USUAL_FOCAL = 430.0
"""Pixels."""

USUAL_SPEED, USUAL_STOP = 0.5, 0.1
"""The car of [A] drives at the first, m/s, and stops within the second, m: its reaction and its braking."""

SPOT_RADIUS = 0.05
"""Radius of a turn on the spot, in units of the body: commands are speed and curvature."""


@dataclass(frozen=True)
class Body:
    """The body of a robot: a rectangle about the point that it turns about.

    Controllers keep their lengths in units of the body: the car of [A] is the unit, and a body of half its size turns,
    stops and looks at half its distances, at half its speed. So what holds for one robot holds for one of any size in a
    world of its size.

    Args:
        length_m: The body has this length.
        width_m: The body has this width.
        min_turn_radius_m: The robot cannot turn more tightly than this; 0 for a differential drive, which turns on the
            spot.
        max_speed_m_per_s: The robot drives no faster than this.
        max_acceleration_m_per_s2: Its speed changes no faster than this.
        reaction_s: The robot obeys so long after a command.

    Raises:
        InputError: A number is out of range.

    >>> Body(0.25, 0.18, 0.2).unit_m
    0.5
    """

    length_m: float = 0.5
    width_m: float = 0.36
    min_turn_radius_m: float = 0.45
    max_speed_m_per_s: float = 1.0
    max_acceleration_m_per_s2: float = 2.5
    reaction_s: float = 0.1

    def __post_init__(self) -> None:
        check_numbers(self, positive=("length_m", "width_m", "max_speed_m_per_s", "max_acceleration_m_per_s2"))

    @property
    def spins(self) -> bool:
        """Whether it turns on the spot."""
        return self.min_turn_radius_m == 0

    @property
    def unit_m(self) -> float:
        """How many metres a metre of the controllers' parameters is, for this body: 1 for the car of [A]."""
        return max(self.size_m, self.min_turn_radius_m / Body().min_turn_radius_m)

    @property
    def size_m(self) -> float:
        """The same by length and width alone: how near things must be seen does not follow the turning radius."""
        usual = Body()
        return max(self.length_m / usual.length_m, self.width_m / usual.width_m)

    @property
    def max_curvature_per_m(self) -> float:
        """Of the tightest turn; that on the spot has `SPOT_RADIUS`."""
        return 1 / (self.min_turn_radius_m or SPOT_RADIUS * self.unit_m)

    @property
    def cruise_m_per_s(self) -> float:
        """The speed at which it stops within the length in which the car of [A] does, in units of its body."""
        unit = self.unit_m
        stopping = braking_speed(USUAL_STOP * unit, self.max_acceleration_m_per_s2, self.reaction_s)
        return min(USUAL_SPEED * unit, stopping, self.max_speed_m_per_s)

    @property
    def speed_ratio(self) -> float:
        """`cruise_m_per_s` as a share of the speed of the car of [A], in units of the body."""
        return min(1.0, round(self.cruise_m_per_s / (USUAL_SPEED * self.unit_m), 9))

    def in_units(self) -> Body:
        """The body in its own units, in which the controllers reckon."""
        lengths = {name: value / self.unit_m for name, value in vars(self).items() if name != "reaction_s"}
        return replace(self, **lengths)


def braking_speed(free: float, deceleration: float, reaction: float) -> float:
    """The speed v, m/s, whose stopping distance v * reaction + v^2 / (2 * deceleration) is `free`, m."""
    lag = deceleration * reaction
    return math.sqrt(lag * lag + 2 * deceleration * max(0.0, free)) - lag


def rig_in_units(rig: StereoRig, unit: float) -> StereoRig:
    """The rig with its lengths in units of so many metres."""
    return replace(
        rig, baseline=rig.baseline / unit, camera_height=rig.camera_height / unit, forward=rig.forward / unit
    )


def proximity_params(rig: StereoRig, body: Body) -> ProximityParams:
    """The usual ones in units of the body; the tilt of the horizon is an angle.

    Rooms do not shrink with a body: what is far is as far as for the car of [A], in metres.
    """
    usual = ProximityParams()
    tilt, near = round(usual.max_tilt_px * rig.focal / USUAL_FOCAL), usual.min_depth_m * body.size_m / body.unit_m
    return replace(usual, max_tilt_px=tilt, min_depth_m=near, far_m=usual.far_m * max(1.0, 1 / body.unit_m))


def match_params(rig: StereoRig, body: Body) -> MatchParams:
    """The disparities at which a body needs ranges: as `MatchParams` has them for the car and the rig of [A]."""
    share, usual = rig.focal * rig.baseline / body.unit_m / USUAL_FOCAL_BASELINE, MatchParams()
    return MatchParams(share * usual.min_disparity_px, share * usual.max_disparity_px)


def search_params(rig: StereoRig, body: Body, rows: int = 1) -> SearchParams:
    """The disparities at which a body needs ranges: as `SearchParams` has them for the car and the rig of [A].

    Rooms do not shrink with a body: small ones are also searched for what is as far as the car of [A] sees, since it
    would match as something near otherwise.
    """
    share, usual = rig.focal * rig.baseline / body.unit_m / USUAL_FOCAL_BASELINE, SearchParams()
    least = max(1, round(share * min(1.0, body.unit_m) * usual.min_disparity_px))
    near = share * body.unit_m / body.size_m
    most = max(least + 2, min(round(near * usual.max_disparity_px), rig.width - 4 * usual.half_width_px))
    return SearchParams(rows=rows, min_disparity_px=least, max_disparity_px=most)
