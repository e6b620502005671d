"""Options of a navigator: the same checks wherever they come from, and what they make."""

from __future__ import annotations

import pytest

from ndtorch.navigation import Grid, Navigator, NavigatorOptions, StereoRig
from ndtorch.navigation.controllers import controller_names
from ndtorch.navigation.options import OPTION_NAMES, options_of

RIG = StereoRig()


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
