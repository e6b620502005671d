"""Drive links by name: `[link] kind = "serial"` in a car's file chooses one.

A link is one file in this folder, or anywhere in a program of one's own: a class that is a `ports.Drive`, a table of
what its section of the file may say, and a function that opens it, with `@link` before it.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar, runtime_checkable

from ndtorch.errors import InputError, did_you_mean
from ndtorch.utils.toml import Strict, check
from ndtorch_robot.ports import CameraPair, Clock, Drive, Report

if TYPE_CHECKING:
    from ndtorch_robot.sim.simulation import Simulation

SERIAL, HOSTED_BOARD, SIMULATED_WORLD = "serial", "hosted-board", "simulated-world"

GONE = {"simulated-board": f"use {HOSTED_BOARD!r}, which runs the same firmware"}
"""Kinds of version 0.2, and what took their place."""


@runtime_checkable
class MovesWorld(Protocol):
    """A link that moves a simulated car: it also knows how that world is seen."""

    def cameras_and_clock(self) -> tuple[CameraPair, Clock]:
        """The cameras in that world, and the clock of a loop in it."""
        ...


@dataclass(frozen=True)
class Opening:
    """What is known when a link is opened.

    Attributes:
        robot: name of the car.
        report: called for every event.
        simulation: the world in which the car is to move, where it is a simulated one.
    """

    robot: str
    report: Report
    simulation: Simulation | None = None


class Kind(NamedTuple):
    """A kind of link: the table of its settings, and what opens it."""

    settings: type[Strict]
    open: Callable[[Any, Opening], Drive]


KINDS: dict[str, Kind] = {}

Settings = TypeVar("Settings", bound=Strict)
Open = Callable[[Settings, Opening], Drive]


def link(name: str, settings: type[Settings]) -> Callable[[Open[Settings]], Open[Settings]]:
    """Decorator: this function opens links of that kind.

    Raises:
        InputError: a name that is taken.
    """

    def register(open_: Open[Settings]) -> Open[Settings]:
        if name in KINDS:
            raise InputError(f"there is a link of the kind {name!r} already")
        KINDS[name] = Kind(settings, open_)
        return open_

    return register


def find_kind(name: str) -> Kind:
    """A kind of link by name; `InputError` with the known ones where there is none."""
    if name not in KINDS:
        for module in pkgutil.iter_modules([str(Path(__file__).parent)]):
            importlib.import_module(f"{__package__}.{module.name}")
    if name not in KINDS and name in GONE:
        raise InputError(f"the link of the kind {name!r} is gone: {GONE[name]}")
    if name not in KINDS:
        raise InputError(
            f"no link of the kind {name!r}, known are {', '.join(sorted(KINDS))}{did_you_mean(name, KINDS)}"
        )
    return KINDS[name]


def check_link(values: Mapping[str, Any]) -> tuple[Kind, Strict]:
    """A `[link]` table: its kind and its settings; `InputError` for an unknown kind, key or value."""
    rest = dict(values)
    kind = find_kind(str(rest.pop("kind", SERIAL)))
    return kind, check(rest, kind.settings, "link")


def open_link(values: Mapping[str, Any], opening: Opening) -> Drive:
    """Open the link of a `[link]` table.

    Raises:
        InputError: as `check_link`; a link that cannot be opened; one that moves no simulated car where it must.
    """
    kind, settings = check_link(values)
    drive = kind.open(settings, opening)
    if opening.simulation is not None and not isinstance(drive, MovesWorld):
        drive.close()
        raise InputError(
            f"a simulated world is driven by link.kind = {HOSTED_BOARD!r} or {SIMULATED_WORLD!r}, "
            f"got {values.get('kind', SERIAL)!r}"
        )
    return drive
