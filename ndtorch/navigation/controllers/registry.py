"""Controllers by name. Those in this folder are found by themselves; others call `register`."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from typing import Any, TypeVar

from ndtorch.errors import InputError, did_you_mean
from ndtorch.navigation.body import Body, params_for_body
from ndtorch.navigation.controllers.contract import Controller
from ndtorch.navigation.stereo.rig import StereoRig

DEFAULT_CONTROLLER = "ranging"

AnyController = TypeVar("AnyController", bound=type[Controller])

_kinds: dict[tuple[str, str], type[Controller]] = {}


def register(kind: AnyController) -> AnyController:
    """Class decorator: the controller can be chosen by its `name` and `backend` from then on.

    Raises:
        InputError: another controller has both.
    """
    known = _kinds.setdefault((kind.name, kind.backend), kind)
    if known.__qualname__ != kind.__qualname__:
        raise InputError(f"there is a controller {kind.name!r} already, {known.__module__}.{known.__qualname__}")
    return kind


@cache
def load_own() -> None:
    """Import every file and folder beside this one, so that their controllers are registered."""
    package = __name__.rpartition(".")[0]
    for entry in pkgutil.iter_modules(importlib.import_module(package).__path__):
        importlib.import_module(f"{package}.{entry.name}")


def controller_names() -> tuple[str, ...]:
    """The names of all controllers, the default first.

    >>> controller_names()
    ('ranging', 'goal', 'published')
    """
    load_own()
    return (DEFAULT_CONTROLLER, *sorted({name for name, _ in _kinds} - {DEFAULT_CONTROLLER}))


def controller_class(name: str, backend: str = "auto") -> type[Controller]:
    """The class of the controller of this name.

    Args:
        backend: `"numba"`, `"torch"`, or `"auto"` for the first of them that the controller has.

    Raises:
        InputError: no such controller, or not with this backend.
    """
    names = controller_names()
    if name not in names:
        raise InputError(f"controller must be one of {', '.join(names)}, got {name!r}{did_you_mean(name, names)}")
    kinds = {kind: _kinds[name, kind] for kind in ("numba", "torch") if (name, kind) in _kinds}
    for kind, chosen in kinds.items():
        if backend in ("auto", kind):
            return chosen
    raise InputError(f"the {name} controller has the backend {' and '.join(kinds)}, got backend={backend!r}")


def make_controller(
    name: str, rig: StereoRig, dt: float, params: Any = None, backend: str = "auto", body: Body | None = None
) -> Controller:
    """The controller of this name for a camera pair and a time step.

    Args:
        params: its numbers, an instance of its `Params`; the defaults where none are given.
        backend: see `controller_class`.
        body: whose units all lengths of the controller are in; the car of [A], whose unit is a metre, by default.

    Raises:
        InputError: no such controller, or parameters of another one.

    >>> from ndtorch.navigation import StereoRig
    >>> type(make_controller('ranging', StereoRig(), 1 / 30)).__name__
    'RangingControl'
    """
    kind = controller_class(name, backend)
    if body is None:
        return kind(rig, dt, params)
    params = params_for_body(kind.Params() if params is None else params, body)
    try:
        return kind(rig.in_units(body.unit_m), dt, params)
    except InputError as error:
        raise InputError(f"{error} (lengths in units of the body, {body.unit_m:.3g} m)") from None
