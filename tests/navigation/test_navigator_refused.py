"""What a navigator cannot use is refused by name."""

import math

import pytest

from ndtorch.errors import InputError
from ndtorch.navigation import Navigator, Rect, StereoRanging, cut_strips
from ndtorch.navigation.controllers.published import SubfieldMotion
from tests.navigation.test_navigator import DT, FIELDS, RIG, frames


def test_bad_input():
    left, right = frames(1, steps=2)
    navigator = Navigator(RIG, DT, controller="published")
    with pytest.raises(InputError, match="alike"):
        navigator(left, right[..., :-2, :])
    with pytest.raises(InputError, match="alike"):
        navigator(left, right[..., :1, :, :])
    with pytest.raises(InputError, match="alike"):
        navigator(left, right.double())
    with pytest.raises(InputError, match="cut to"):
        navigator(left[..., :-2, :], right[..., :-2, :])
    with pytest.raises(InputError, match="C = 1 or 3"):
        navigator(left[..., :2, :, :], right[..., :2, :, :])
    with pytest.raises(InputError, match=r"frames \[\.\.\., T, C, H, W\]"):
        navigator(left[0], right[0])
    with pytest.raises(InputError, match="uint8 or floating"):
        navigator(left.long(), right.long())
    with pytest.raises(InputError, match="inside"):
        SubfieldMotion(RIG, DT, (Rect(0, 10, 0, 10), Rect(0, 10, 300, 330)))
    with pytest.raises(InputError, match="one size"):
        SubfieldMotion(RIG, DT, (Rect(0, 10, 0, 10), Rect(0, 10, 0, 12)))
    with pytest.raises(InputError, match="angles"):
        StereoRanging(RIG, DT, angles="cubic")
    strips = [cut_strips(x, rect, RIG) for x, rect in zip((left, right), FIELDS, strict=True)]
    with pytest.raises(InputError, match="same frames"):
        navigator(*(s._replace(row=s.row[:1]) for s in strips))


@pytest.mark.parametrize("value", [math.nan, math.inf, 255.0])
@pytest.mark.parametrize("place", ["field", "row"])
def test_unusable_values(value, place):
    left, right = frames(1, steps=3)
    row, column = (FIELDS[1].top + 1, FIELDS[1].left + 2) if place == "field" else (RIG.row, 17)
    right[1, 0, row, column] = value
    with pytest.raises(InputError, match="finite"):
        Navigator(RIG, DT, controller="published")(left, right)
    right[1, 0, row, column] = 0.5
    right[0, 1, row, column] = value  # already in the first frame
    with pytest.raises(InputError, match="finite"):
        Navigator(RIG, DT, controller="published")(left, right)
