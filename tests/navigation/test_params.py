"""Parameters and options of navigation: each has a sentence of its own, earlier names answer with the present ones."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil

import pytest

import ndtorch.navigation
from ndtorch.errors import InputError
from ndtorch.navigation import (
    AvoidanceParams,
    FeatureParams,
    Grid,
    MatchParams,
    Navigator,
    NavigatorOptions,
    RangingParams,
    SearchParams,
    StereoRig,
)
from ndtorch.navigation.body import Body
from ndtorch.navigation.controllers import controller_names
from ndtorch.navigation.controllers.ranging.floor_view import FloorParams
from ndtorch.navigation.local_grid.grid import LocalGridParams
from ndtorch.navigation.options import OPTION_NAMES, options_of
from ndtorch_robot.navigator_options import described

MODULES = [
    importlib.import_module(found.name)
    for found in pkgutil.walk_packages(ndtorch.navigation.__path__, "ndtorch.navigation.")
]
PARAMS = {
    kind
    for module in MODULES
    for name, kind in vars(module).items()
    if dataclasses.is_dataclass(kind) and (name.endswith("Params") or kind is Body)
}


@pytest.mark.parametrize("kind", sorted(PARAMS, key=lambda kind: kind.__name__))
def test_every_parameter_has_a_whole_sentence_of_its_own(kind: type) -> None:
    words = described(kind.__doc__ or "")
    names = [field.name for field in dataclasses.fields(kind)]
    assert sorted(words) == sorted(names)
    bad = [n for n, text in words.items() if not (text[0].isupper() and text.split(" Raises")[0].endswith("."))]
    assert bad == []


@pytest.mark.parametrize(
    ("kind", "before", "now"),
    [
        (RangingParams, "speed", "speed_m_per_s"),
        (FloorParams, "near", "near_m"),
        (LocalGridParams, "cell", "cell_m"),
        (AvoidanceParams, "turn_time", "turn_s"),
        (SearchParams, "ratio", "uniqueness_ratio"),
        (FeatureParams, "follow", "follow_reach_px"),
        (MatchParams, "min_disparity", "min_disparity_px"),
        (Body, "length", "length_m"),
    ],
)
def test_earlier_and_misspelt_names_answer(kind: type, before: str, now: str) -> None:
    with pytest.raises(InputError, match=f"{before} of {kind.__name__} is now {now}"):
        kind(**{before: 1.0})
    with pytest.raises(InputError, match=f"has no {now}x; did you mean {now}"):
        kind(**{f"{now}x": 1.0})


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
