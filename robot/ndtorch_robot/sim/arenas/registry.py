"""Arenas by name: an arena is a function from a seed to a plan, with `@arena` before it, in a file of this folder."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from pathlib import Path

from ndtorch.errors import InputError, did_you_mean
from ndtorch_robot.sim.plan import Plan

Make = Callable[[int], Plan]

REGISTERED: dict[str, tuple[Make, bool]] = {}


def arena(name: str, test: bool = False) -> Callable[[Make], Make]:
    """Decorator: this function makes the arena of that name."""

    def register(make: Make) -> Make:
        REGISTERED[name] = make, test
        return make

    return register


def arenas(test: bool | None = None) -> dict[str, Make]:
    """The arenas by name: those that controllers were developed in, test arenas, or with None all of them."""
    for module in pkgutil.iter_modules([str(Path(__file__).parent)]):
        importlib.import_module(f"{__package__}.{module.name}")
    return {name: make for name, (make, for_test) in REGISTERED.items() if test is None or test == for_test}


def load_arena(name: str, seed: int = 0) -> Plan:
    """The plan of an arena by name, or of a file that ends in `.toml`."""
    if name.endswith(".toml"):
        from ndtorch_robot.sim.arena_file import read_arena

        return read_arena(Path(name))
    known = arenas()
    if name not in known:
        raise InputError(
            f"no arena {name!r}, choose one of {', '.join(known)} or a .toml file{did_you_mean(name, known)}"
        )
    return known[name](seed)
