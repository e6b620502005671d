"""Every number with which a public module or scene is made, against odd values: one `InputError` that names it."""

from __future__ import annotations

import dataclasses
import inspect
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pydantic
import pytest
import torch

from ndtorch import binding, navigation, scenes, vision
from ndtorch.errors import InputError

NEEDED: dict[str, Any] = {
    "size": (64, 80),
    "fps": 30.0,
    "dt": 1 / 30,
    "dt_in": 1 / 30,
    "dt_out": 0.01,
    "rig": navigation.StereoRig(width=64, height=48, focal=43.0),
    "tau": 0.1,
    "seconds": 0.3,
    "radius": 0.01,
    "speeds": [1.0, 2.0],
    "color": (1.0, 0.5, 0.0),
    "direction": 30.0,
    "orientation": 30.0,
    "start": (10.0, 20.0),
    "features": vision.VisualFeatures((16, 20)),
    "row": torch.tanh,
    "column": torch.tanh,
    "grid": (4, 4),
    "spacing": 4.0,
    "hue": 120.0,
    "saturation": 0.5,
    "lightness": 0.5,
}
"""What has no default, and what makes it quick."""

ODD: tuple[Any, ...] = (
    *(math.nan, -math.inf, math.inf, -1, -0.5, 0, 2.5, True, 10**400, None, "x", [1], [math.nan]),
    *((math.nan, 1), (-1, 1), (0, 0), (1, 2, 3)),
)

ENDLESS = {"reach", "lifetime", "memory", "radius_limit"}
"""What may be infinite, beside time constants."""

ELSEWHERE = {"BoundObject", "MovingGrating", "Navigator", "train_first_stage"}
"""What is told rather than asked for, what takes lists of numbers, what is made of the others, and what takes long."""


def tables(thing: object) -> bool:
    """Whether it is a table of constants, which tests/test_numbers.py tries."""
    if not inspect.isclass(thing):
        return False
    return issubclass(thing, tuple | pydantic.BaseModel) or (
        dataclasses.is_dataclass(thing) and thing is not binding.LearningRule and thing is not scenes.Bar
    )


def makers() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """What can be made of numbers, by name, and what it has to be given."""
    found = {}
    for module in (vision, binding, navigation, scenes):
        for name in module.__all__:
            thing = getattr(module, name)
            if not (inspect.isclass(thing) or inspect.isfunction(thing)) or tables(thing) or inspect.isabstract(thing):
                continue
            places = inspect.signature(thing).parameters.values()
            named = [p for p in places if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)]
            needed = [p.name for p in named if p.default is p.empty or p.name == "size"]
            if name not in ELSEWHERE and set(needed) <= set(NEEDED):
                found[name] = (thing, {each: NEEDED[each] for each in needed})
    return found


MAKERS = makers()


def numbers_of(name: str) -> dict[str, Any]:
    """The parameters that are numbers, sizes or places, and what they are in a good call."""
    make, given = MAKERS[name]
    found = {}
    for place in inspect.signature(make).parameters.values():
        usual, kind = given.get(place.name, place.default), str(place.annotation)
        number = isinstance(usual, int | float) and not isinstance(usual, bool)
        pair = isinstance(usual, tuple) and bool(usual) and isinstance(usual[0], int | float)
        if number or pair or (usual is None and ("float" in kind or "int" in kind) and "Callable" not in kind):
            found[place.name] = usual
    return found


def wrong(place: inspect.Parameter, usual: Any, value: Any) -> bool:
    """Whether a value can never be right there; others may be taken or refused."""
    kind, name = str(place.annotation), place.name
    several = ("PerScene", "PerBar", "Sequence", "Tensor", "tuple")
    lists = isinstance(usual, tuple) or name == "seed" or any(word in kind for word in several)
    if value is None:
        return place.default is not None and "None" not in kind and name != "orientation"
    if isinstance(value, str) or value == [math.nan] or (isinstance(value, tuple) and value[0] is math.nan):
        return True
    if isinstance(value, list | tuple):
        return not lists
    if value == 10**400:
        return isinstance(usual, float)
    if value == math.inf:
        return not (name.startswith("tau") or name in ENDLESS)
    return not math.isfinite(value)


def outcome(name: str, part: str, value: Any) -> str:
    """What came of it: "" where it was refused by name, or may be what it is."""
    make, given = MAKERS[name]
    try:
        make(**{**given, part: value})
    except InputError as error:
        said = str(error)
        return "" if part in said and "\n" not in said else f"not named: {said}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    place = inspect.signature(make).parameters[part]
    return "taken" if wrong(place, given.get(part, place.default), value) else ""


@pytest.mark.parametrize("name", [name for name in MAKERS if numbers_of(name)])
def test_odd_numbers_are_refused_by_name(name: str) -> None:
    make, given = MAKERS[name]
    make(**given)
    tried = [(part, value) for part in numbers_of(name) for value in ODD]
    bad = [f"{part}={str(value)[:20]}: {found}" for part, value in tried if (found := outcome(name, part, value))]
    assert not bad


def test_numbers_of_numpy_are_numbers() -> None:
    frame = scenes.two_bars(seconds=0.1, fluctuation="random", seed=np.int64(3), size=(np.int64(200), 200))
    plain = scenes.two_bars(seconds=0.1, fluctuation="random", seed=3, size=(200, 200))
    assert torch.equal(frame.frames(0, 1), plain.frames(0, 1))
    assert binding.InhibitoryNetwork(np.int64(3), np.float32(0.01)).neurons == 3
    assert binding.ObjectFiles((np.int64(4), 5), np.float64(4.0)).grid == (4, 5)
    assert vision.VisualFeatures(np.zeros((16, 20)).shape, np.float64(0.01)).size == (16, 20)
