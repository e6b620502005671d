"""Controllers by name. Those in this folder are found by themselves; others call `register`."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from typing import Any, TypeVar

from ndtorch.errors import InputError, did_you_mean
from ndtorch.navigation.controllers.contract import Controller
from ndtorch.navigation.stereo.rig import StereoRig

DEFAULT_CONTROLLER = "ranging"
"""The controller that steers where none is named, in Python and at the command line."""

AnyController = TypeVar("AnyController", bound=type[Controller])

_kinds: dict[str, dict[str, type[Controller]]] = {}


def register(kind: AnyController) -> AnyController:
    """Class decorator: the controller can be chosen by its `name` and `backend` from then on.

    Raises:
        InputError: another controller has both.
    """
    kinds = _kinds.setdefault(kind.name, {})
    known = kinds.setdefault(kind.backend, kind)
    if (known.__module__, known.__qualname__) != (kind.__module__, kind.__qualname__):
        raise InputError(f"there is a controller {kind.name!r} already, {known.__module__}.{known.__qualname__}")
    kinds[kind.backend] = kind
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


def controller_class(name: str, backend: str = "auto") -> type[Controller]:
    """The class of the controller of this name.

    Args:
        backend: `"numba"`, `"torch"`, or `"auto"` for the first of them that the controller has.

    Raises:
        InputError: no such controller, or not with this backend.
    """
    names = controller_names()
    if name not in names:
        raise InputError(
            f"controller must be one of {', '.join(map(repr, names))}, got {name!r}{did_you_mean(name, names)}"
        )
    if backend not in ("auto", *BACKENDS):
        raise InputError(f"backend must be 'auto', 'numba' or 'torch', got {backend!r}")
    kinds = _kinds[name]
    for found in BACKENDS if backend == "auto" else (backend,):
        if found in kinds:
            return kinds[found]
    raise InputError(f"the {name} controller has no backend {backend!r}, only {' and '.join(map(repr, kinds))}")


BACKENDS = ("numba", "torch")


def make_controller(name: str, rig: StereoRig, dt: float, params: Any = None, backend: str = "auto") -> Controller:
    """The controller of this name for a camera pair and a time step.

    Args:
        params: its numbers, an instance of its `Params`; the defaults where none are given.
        backend: see `controller_class`.

    Raises:
        InputError: no such controller, or parameters of another one.

    >>> from ndtorch.navigation import StereoRig
    >>> type(make_controller('ranging', StereoRig(), 1 / 30)).__name__
    'RangingControl'
    """
    return controller_class(name, backend)(rig, dt, params)
