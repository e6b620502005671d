"""Options of a navigator: the same checks wherever they come from, and what they make."""

from __future__ import annotations

from typing import Any

import pytest

from ndtorch.errors import InputError
from ndtorch.navigation import Grid, Navigator, NavigatorOptions, StereoRig
from ndtorch.navigation.controllers import controller_names
from ndtorch.navigation.options import OPTION_NAMES, options_of

RIG = StereoRig()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"controller": "publish"}, "did you mean published"),
        ({"features": 0}, "features must be a whole number from 1 to 64, got 0"),
        ({"features": True}, "features must be a whole number"),
        ({"angle": "tan"}, "angle must be 'atan' or 'linear', got 'tan'"),
        ({"map_update": "beam"}, "map_update must be 'beams' or 'log-odds', got 'beam'"),
    ],
)
def test_what_cannot_be_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        NavigatorOptions(**options)


def test_options_are_picked_out_of_other_keys() -> None:
    assert options_of({"features": 3, "arena": "hall"}) == NavigatorOptions(features=3)
    assert set(OPTION_NAMES) == set(vars(NavigatorOptions()))


@pytest.mark.parametrize("controller", controller_names())
def test_the_navigator_has_what_was_chosen(controller: str) -> None:
    options = NavigatorOptions(controller, features=3, angle="linear", feature_position="motion", prediction=True)
    navigator = options.navigator(RIG, 20.0, Grid(-1, 1, -1, 1))
    assert isinstance(navigator, Navigator)
    assert navigator.grid_map is not None
    assert type(navigator.controller).__module__.split(".")[3] == controller
    assert options.fields(RIG) == navigator.controller.fields
    assert options.navigator(RIG, 20.0).grid_map is None
