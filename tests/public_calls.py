"""Every public function, constructor and method, found by the names that the packages export, and values for them."""

from __future__ import annotations

import enum
import importlib
import inspect
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import torch

import ndtorch
from ndtorch import binding, navigation, scenes, vision

PACKAGES = (
    *("ndtorch", "ndtorch.vision", "ndtorch.scenes", "ndtorch.binding", "ndtorch.navigation"),
    *(f"ndtorch_robot.{room}" for room in ("calibration", "cameras", "link", "recording", "view")),
)

RIG = navigation.StereoRig()

ODD: tuple[Any, ...] = (None, True, "x", object(), 1.5, -1, math.nan, 10**400, 1e18, [None], {}, b"x")

RIGHT: dict[str, Any] = {
    **{"size": (48, 48), "fps": 30.0, "dt": 1 / 30, "dt_in": 1 / 30, "dt_out": 0.01, "rig": RIG, "tau": 0.1},
    **{"seconds": 0.3, "speeds": [1.0, 2.0], "color": (1.0, 0.5, 0.0), "direction": 30.0, "orientation": 30.0},
    **{"start": (10.0, 20.0), "features": vision.VisualFeatures((16, 20)), "row": torch.tanh, "column": torch.tanh},
    **{"grid": (4, 4), "spacing": 4.0, "hue": 120.0, "saturation": 0.5, "lightness": 0.5, "path": "written"},
    "weights": torch.full((10, 10), 0.02).fill_diagonal_(0.0),
    "inputs": torch.rand(4, 10, generator=torch.Generator().manual_seed(0)),
    "sensor": vision.NDMin(),
    "bars": [scenes.Bar((1.0, 0.0, 0.0), 0.0, (10.0, 10.0))],
}
"""Right values by the name of the parameter, whatever the call."""

LONG = {"train_first_stage", "SerialDrive", "warm_up"}
"""What takes long or needs hardware."""


def public_things(packages: Iterable[str] = PACKAGES) -> Iterator[tuple[str, Any]]:
    """Every exported function and class, once; those that validate themselves and plain tuples are left out."""
    seen = set()
    for package in packages:
        module = importlib.import_module(package)
        for name in module.__all__:
            thing = getattr(module, name)
            plain = inspect.isclass(thing) and issubclass(thing, (tuple, enum.Enum, BaseException))
            if id(thing) in seen or plain or not callable(thing) or getattr(thing, "_is_protocol", False):
                continue
            seen.add(id(thing))
            yield f"{package}.{name}", thing


def methods_of(kind: type) -> list[str]:
    """Its public methods of this project that take something."""
    found: dict[str, Any] = {}
    decorated = getattr(kind, "__pydantic_decorators__", None)
    validators = {*decorated.field_validators, *decorated.model_validators} if decorated else set()
    for base in kind.__mro__:
        if base.__module__.startswith("ndtorch"):
            for name, member in vars(base).items():
                call = getattr(member, "__func__", member)
                if not name.startswith("_") and inspect.isfunction(call) and name not in LONG | validators:
                    found.setdefault(name, call)
    return [name for name, call in found.items() if set(inspect.signature(call).parameters) - {"self", "cls"}]


def value_for(place: inspect.Parameter) -> Any:
    """A value of the kind that a parameter asks for."""
    kind = str(place.annotation)
    if place.name in RIGHT:
        return RIGHT[place.name]
    if "Tensor" in kind:
        return torch.rand(2, 3, 48, 48, generator=torch.Generator().manual_seed(0))
    usual = (("float", 1.0), ("int", 2), ("Path", Path("nowhere")), ("str", "x"))
    return next((value for word, value in usual if word in kind), None)


def places_of(call: Callable[..., Any]) -> list[inspect.Parameter]:
    places = inspect.signature(call).parameters.values()
    return [place for place in places if place.kind not in (place.VAR_POSITIONAL, place.VAR_KEYWORD)]


def needed_by(call: Callable[..., Any]) -> dict[str, Any]:
    """Values for all parameters without a default."""
    return {place.name: value_for(place) for place in places_of(call) if place.default is place.empty}


def calls_of(thing: Any) -> Iterator[tuple[str, Callable[..., Any]]]:
    """A function, or a constructor and the methods of what it makes, where it can be made of `RIGHT`."""
    if thing.__name__ in LONG:
        return
    if not inspect.isabstract(thing):
        yield "", thing
    if inspect.isclass(thing):
        try:
            own = {"PublishedModel": "published", "ScaleFreeModel": "scale-free", "RetinotopicModel": "retinotopic"}
            named = own.get(thing.__name__, "foreground" if thing in (binding.ForegroundModel,) else "")
            made = ndtorch.load(named, size=48) if named else thing(**needed_by(thing))
        except (ValueError, TypeError):
            return
        for name in methods_of(thing):
            yield f".{name}", getattr(made, name)
