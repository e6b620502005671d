"""No class of numbers takes NaN, or infinity where it means nothing: one line says which number it is."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import math
import pkgutil
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import pytest

from ndtorch.config import Constants
from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict

PLACES = (
    "ndtorch.binding",
    "ndtorch.vision",
    "ndtorch.navigation",
    "ndtorch_robot.link",
    "ndtorch_robot.recording",
    "ndtorch_robot.safety",
)


def modules() -> Iterator[ModuleType]:
    """Every module that holds classes of numbers."""
    for place in PLACES:
        module = importlib.import_module(place)
        yield module
        for found in pkgutil.walk_packages(getattr(module, "__path__", ()), place + "."):
            yield importlib.import_module(found.name)


ENDLESS = {
    "RangingParams.unknown_margin_m",
    "LocalGridParams.lifetime_s",
    "FeatureTrackParams.max_lost_s",
    "SafetyLimits.recovery",
}
"""What may last for ever, beside time constants and what is infinite unless somebody says otherwise."""


def usual(kind: type) -> dict[str, Any]:
    """The numbers of a class and the tuples of them, by field; empty where it cannot be made without saying more."""
    try:
        made = kind()
    except (InputError, TypeError):
        return {}
    names = kind.model_fields if issubclass(kind, Constants) else [field.name for field in dataclasses.fields(kind)]
    fields = {name: getattr(made, name) for name in names}
    return {
        name: value
        for name, value in fields.items()
        if (isinstance(value, int | float) and not isinstance(value, bool))
        or (isinstance(value, tuple) and value and all(isinstance(part, float) for part in value))
    }


def is_frozen(kind: type) -> bool:
    """Whether it is of numbers that stay: a table of constants, or a frozen dataclass. Others gather results.

    Tables of files are checked by `ndtorch.utils.toml.check`.
    """
    if issubclass(kind, Constants | Strict):
        return issubclass(kind, Constants)
    return dataclasses.is_dataclass(kind) and kind.__dataclass_params__.frozen  # type: ignore[attr-defined]


def classes() -> dict[str, type]:
    """All that are made of numbers with defaults."""
    pytest.importorskip("serial")
    found = [kind for module in modules() for kind in vars(module).values() if inspect.isclass(kind)]
    chosen = [kind for kind in found if is_frozen(kind) and usual(kind)]
    return {f"{kind.__module__}.{kind.__qualname__}": kind for kind in chosen}


def endless(name: str, field: str, value: object) -> bool:
    return f"{name}.{field}" in ENDLESS or field.startswith("tau_") or value == math.inf


def test_nan_is_refused_by_every_class_of_numbers_and_infinity_where_it_means_nothing() -> None:
    bad, all_of_them = [], classes()
    assert {"PlannerParams", "FeatureTrackParams", "OwnerCriteria", "ScaleFreeRule", "SafetyLimits", "Grid"} <= {
        kind.__name__ for kind in all_of_them.values()
    }
    for name, kind in all_of_them.items():
        for field, value in usual(kind).items():
            odd = [math.nan, -math.inf] + ([] if endless(kind.__name__, field, value) else [math.inf])
            for number in odd:
                given = (*value[:-1], number) if isinstance(value, tuple) else number
                try:
                    kind(**{field: given})
                    bad.append(f"{name}({field}={given}) is taken")
                except InputError as error:
                    if field not in str(error) or "\n" in str(error):
                        bad.append(f"{name}({field}={given}): {error}")
    assert not bad


SIGNED = {
    *("OwnerCriteria.alike", "OwnerReadout.alike", "SingleReadout.agrees"),
    *("Grid.right", "Grid.top", "FloorParams.outer_rad"),
}
"""Correlations, cosines and directions: positive as they are, but a little below 0 too."""


def test_what_is_positive_is_never_far_below_zero_and_only_signed_numbers_are_a_little() -> None:
    bad = []
    for name, kind in classes().items():
        for field, value in usual(kind).items():
            if isinstance(value, tuple) or not value > 0:
                continue
            slightly = [] if f"{kind.__name__}.{field}" in SIGNED else [-1] if isinstance(value, int) else [-1e-3, -1]
            for number in (*slightly, -(10**6)):
                try:
                    kind(**{field: number})
                    bad.append(f"{name}({field}={number}) is taken")
                except InputError as error:
                    if field not in str(error):
                        bad.append(f"{name}({field}={number}): {error}")
    assert not bad


@pytest.mark.parametrize(
    ("name", "field", "value"),
    [
        ("ColorParams", "white_ratio", (0.7, 0.5)),
        ("ColorParams", "black_ratio", (0.1, 1.5)),
        ("OwnerReadout", "delays", (0.1, 0.0)),
        ("ScaleFreeRule", "lowest", 0.1),
        ("ScaleFreeRule", "tau_boost", 0.0),
        ("PlannerParams", "footprint_centers_m", ()),
        ("PlannerParams", "inflation_radius_m", 0.24),
        ("PlannerParams", "costmap_cells", 0),
        ("ProximityParams", "unbroken_correlation", 1.1),
        ("ProximityParams", "floor_max_depth_m", 0.8),
    ],
)
def test_pairs_and_limits_that_cannot_be(name: str, field: str, value: Any) -> None:
    for kind in named_of_all(name):
        with pytest.raises(InputError, match=field):
            kind(**{field: value})


def named_of_all(name: str) -> list[type]:
    found = [kind for each, kind in classes().items() if each.endswith(f".{name}")]
    assert found
    return found
