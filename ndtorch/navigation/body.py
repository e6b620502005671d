"""The body of a robot, from which the lengths of everything that drives it follow."""

from __future__ import annotations

from dataclasses import dataclass

from ndtorch.arguments import check_numbers, check_signs, renamed_fields


@renamed_fields(
    length="length_m, the whole length", width="width_m, the whole width", room="RangingParams.safety_margin_m"
)
@dataclass(frozen=True)
class Body:
    """The body of a robot: a rectangle about the point that it turns about.

    Args:
        length_m: The body has this length.
        width_m: The body has this width.

    Raises:
        InputError: A number is out of range.
    """

    length_m: float = 0.5
    width_m: float = 0.36

    def __post_init__(self) -> None:
        check_numbers(self)
        check_signs(self, positive=vars(self))
