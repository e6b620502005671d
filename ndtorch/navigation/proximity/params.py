"""Parameters of the proximity check."""

from __future__ import annotations

from dataclasses import dataclass

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError


@dataclass(frozen=True)
class ProximityParams:
    """Parameters of the proximity check of a car that is stationary.

    Args:
        min_depth_m: Obstacles nearer to the cameras than this are not searched for.
        max_depth_m: Obstacles farther from the cameras than this are not near.
        far_m: What is at most this far can match where it is; what is farther may match as something near.
        half_width_m: Obstacles farther to the side of the car's middle than this are ignored.
        min_support: An obstacle needs this many neighbouring columns of the same depth.
        mismatch_max_places: This many places or more are kept even if the floor seems to be unbroken.
        min_floor_correlation: Both cameras see one floor from this correlation on.
        unbroken_correlation: The floor has no obstacle on it from this correlation on.
        floor_min_depth_m: The floor ahead is compared from this depth on.
        floor_max_depth_m: The floor ahead is compared up to this depth.
        floor_half_width_m: The floor ahead is compared within this distance of the car's middle.
        max_tilt_px: The horizon may be this many rows higher or lower than the rig gives it.

    Raises:
        InputError: A number is out of range.
    """

    min_depth_m: float = 0.25
    max_depth_m: float = 0.95
    far_m: float = 8.0
    half_width_m: float = 0.3
    min_support: int = 5
    mismatch_max_places: int = 12
    min_floor_correlation: float = 0.7
    unbroken_correlation: float = 0.95
    floor_min_depth_m: float = 0.8
    floor_max_depth_m: float = 1.15
    floor_half_width_m: float = 0.15
    max_tilt_px: int = 26

    def __post_init__(self) -> None:
        free = {"max_tilt_px", "min_floor_correlation", "unbroken_correlation"}
        check_numbers(self, positive=set(vars(self)) - free)
        if not self.min_depth_m < self.max_depth_m:
            raise InputError(f"expected min_depth_m < max_depth_m, got {self.min_depth_m} and {self.max_depth_m}")
        if not (self.min_floor_correlation <= 1 and self.unbroken_correlation <= 1):
            raise InputError(f"min_floor_correlation and unbroken_correlation must be at most 1, got {self}")
        if not self.floor_min_depth_m < self.floor_max_depth_m:
            raise InputError(
                "expected floor_min_depth_m < floor_max_depth_m, "
                f"got {self.floor_min_depth_m} and {self.floor_max_depth_m}"
            )
