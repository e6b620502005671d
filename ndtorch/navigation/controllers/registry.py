"""Controllers by name. Those in this folder are found by themselves; others call `register`."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from typing import Any, TypeVar

from ndtorch.errors import InputError, did_you_mean
from ndtorch.navigation.controllers.contract import Controller
from ndtorch.navigation.rig import StereoRig

DEFAULT_CONTROLLER = "ranging"
"""The controller that steers where none is named, in Python and at the command line."""

AnyController = TypeVar("AnyController", bound=type[Controller])

_kinds: dict[str, type[Controller]] = {}


def register(kind: AnyController) -> AnyController:
    """Class decorator: the controller can be chosen by its `name` from then on.

    Raises:
        InputError: another controller has that name.
    """
    known = _kinds.setdefault(kind.name, kind)
    if (known.__module__, known.__qualname__) != (kind.__module__, kind.__qualname__):
        raise InputError(f"there is a controller {kind.name!r} already, {known.__module__}.{known.__qualname__}")
    _kinds[kind.name] = kind
    return kind


@cache
def load_own() -> None:
    """Import every file and folder beside this one, so that their controllers are registered."""
    package = __name__.rpartition(".")[0]
    for found in pkgutil.iter_modules(importlib.import_module(package).__path__):
        importlib.import_module(f"{package}.{found.name}")


def controller_names() -> tuple[str, ...]:
    """The names of all controllers, the default first.

    >>> controller_names()
    ('ranging', 'goal', 'published')
    """
    load_own()
    return (DEFAULT_CONTROLLER, *sorted(name for name in _kinds if name != DEFAULT_CONTROLLER))


def controller_class(name: str) -> type[Controller]:
    """The class of the controller of this name.

    Raises:
        InputError: no such controller.
    """
    names = controller_names()
    if name not in names:
        raise InputError(
            f"controller must be one of {', '.join(map(repr, names))}, got {name!r}{did_you_mean(name, names)}"
        )
    return _kinds[name]


def make_controller(name: str, rig: StereoRig, dt: float, params: Any = None) -> Controller:
    """The controller of this name for a camera pair and a time step.

    Args:
        params: its numbers, an instance of its `Params`; the defaults where none are given.

    Raises:
        InputError: no such controller, or parameters of another one.

    >>> from ndtorch.navigation import StereoRig
    >>> type(make_controller('ranging', StereoRig(), 1 / 30)).__name__
    'RangingControl'
    """
    return controller_class(name)(rig, dt, params)
