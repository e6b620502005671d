"""How a car that stands looks at what is right before it."""

from __future__ import annotations

from dataclasses import dataclass

from ndtorch.arguments import check_numbers, check_signs
from ndtorch.errors import InputError


@dataclass(frozen=True)
class NearParams:
    """How a car that stands looks at what is right before it.

    Args:
        nearest, farthest: depths from the cameras that count as near, m.
        beside: how far to either side of the car's middle, m.
        half: pairs of pixels compared to either side of a place.
        ratio: a match must differ by less than this share of the best one elsewhere.
        texture: least mean step of brightness from pixel to pixel around a place.
        enough: places that must agree on something near.
        floor: correlation from which what both see right ahead is one floor.
        unbroken: correlation from which nothing stands on that floor.
        few: so many places on such a floor, or more, are believed all the same.
        through_to: depth up to which a thing is not believed behind which such a floor is seen, m.
        middle: how far to either side of the car's middle a thing would break that floor, m.
        floor_from, floor_to: depths of the floor right ahead that must be seen, m.
        floor_beside: how far to either side of the car's middle, m.
        tilt: rows by which the horizon may lie higher or lower than the rig says.
        narrowest, pixels: fewer columns of a row, or pixels in all, that both see are not compared.
        blank: standard deviation of the brightness below which nothing is seen.

    Raises:
        InputError: numbers out of range.
    """

    nearest: float = 0.25
    farthest: float = 0.95
    beside: float = 0.3
    half: int = 8
    ratio: float = 0.6
    texture: float = 0.003
    enough: int = 5
    floor: float = 0.7
    unbroken: float = 0.95
    few: int = 12
    through_to: float = 0.6
    middle: float = 0.1
    floor_from: float = 0.8
    floor_to: float = 1.15
    floor_beside: float = 0.15
    tilt: int = 26
    narrowest: int = 5
    pixels: int = 150
    blank: float = 0.002

    def __post_init__(self) -> None:
        check_numbers(self)
        if not (0 < self.nearest < self.farthest and self.beside > 0):
            raise InputError(f"expected 0 < nearest < farthest and beside > 0, got {self}")
        if not (self.floor_beside > 0 and self.through_to > 0):
            raise InputError(f"expected floor_beside and through_to > 0, got {self.floor_beside}, {self.through_to}")
        if not (self.half >= 1 and 0 < self.ratio <= 1 and self.texture >= 0 and self.enough >= 1 and self.blank >= 0):
            raise InputError(f"expected half and enough >= 1 and 0 < ratio <= 1, got {self}")
        check_signs(self, positive=("few", "narrowest", "pixels"))
        if not (self.floor <= 1 and self.unbroken <= 1):
            raise InputError(f"floor and unbroken are correlations of 0..1, got {self.floor} and {self.unbroken}")
        if not 0 < self.floor_from < self.floor_to:
            raise InputError(f"expected 0 < floor_from < floor_to, got {self.floor_from} and {self.floor_to}")
