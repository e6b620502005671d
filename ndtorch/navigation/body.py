"""The body of a robot, from which the lengths of everything that drives it follow."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ndtorch.arguments import check_numbers, check_signs, renamed_fields
from ndtorch.navigation.stereo.correspondence import MatchParams
from ndtorch.navigation.stereo.rig import StereoRig
from ndtorch.navigation.stereo.search import SearchParams

USUAL_FOCAL_BASELINE = 129.0
"""Pixels times metres of the rig of [A], for which the disparities of `MatchParams` and `SearchParams` are."""


@renamed_fields(length="length_m (all of it)", width="width_m (all of it)", room="RangingParams.safety_margin_m")
@dataclass(frozen=True)
class Body:
    """The body of a robot: a rectangle about the point that it turns about.

    Controllers keep their lengths in units of the body: the car of [A] is the unit, and a body of half its size turns,
    stops and looks at half its distances, at half its speed. So what holds for one robot holds for one of any size in a
    world of its size.

    Args:
        length_m: The body has this length.
        width_m: The body has this width.
        min_turn_radius_m: The robot cannot turn more tightly than this; 0 for a robot that turns on the spot.

    Raises:
        InputError: A number is out of range.

    >>> Body(0.25, 0.18, 0.2).unit_m
    0.5
    """

    length_m: float = 0.5
    width_m: float = 0.36
    min_turn_radius_m: float = 0.45

    def __post_init__(self) -> None:
        check_numbers(self)
        check_signs(self, positive=("length_m", "width_m"))

    @property
    def unit_m(self) -> float:
        """How many metres a metre of the controllers' parameters is, for this body: 1 for the car of [A]."""
        usual = Body()
        return max(
            self.length_m / usual.length_m,
            self.width_m / usual.width_m,
            self.min_turn_radius_m / usual.min_turn_radius_m,
        )

    def in_units(self) -> Body:
        """The body in its own units, in which the controllers reckon."""
        unit = self.unit_m
        return Body(self.length_m / unit, self.width_m / unit, self.min_turn_radius_m / unit)


def rig_in_units(rig: StereoRig, unit: float) -> StereoRig:
    """The rig with its lengths in units of so many metres."""
    return replace(
        rig, baseline=rig.baseline / unit, camera_height=rig.camera_height / unit, forward=rig.forward / unit
    )


def match_params(rig: StereoRig, body: Body) -> MatchParams:
    """The disparities at which a body needs ranges: as `MatchParams` has them for the car and the rig of [A]."""
    share, usual = rig.focal * rig.baseline / body.unit_m / USUAL_FOCAL_BASELINE, MatchParams()
    return MatchParams(share * usual.min_disparity_px, share * usual.max_disparity_px)


def search_params(rig: StereoRig, body: Body, rows: int = 1) -> SearchParams:
    """The disparities at which a body needs ranges: as `SearchParams` has them for the car and the rig of [A]."""
    share, usual = rig.focal * rig.baseline / body.unit_m / USUAL_FOCAL_BASELINE, SearchParams()
    least = max(1, round(share * usual.min_disparity_px))
    most = max(least + 2, round(share * usual.max_disparity_px))
    return SearchParams(rows=rows, min_disparity_px=least, max_disparity_px=most)
