"""Parts by name that are found in a folder: drive links and bridges.

A part is one file in its folder, or anywhere in a program of one's own: a table of what its section of a car's file may
say, and a function that opens it, which is registered by a decorator.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

from ndtorch.errors import InputError, did_you_mean
from ndtorch.utils.toml import Strict, check

Opening = TypeVar("Opening")
Opened = TypeVar("Opened")
Settings = TypeVar("Settings", bound=Strict)


class Kind(NamedTuple):
    """A kind of part: the table of its settings, and what opens it."""

    settings: type[Strict]
    open: Callable[[Any, Any], Any]


class Kinds(Generic[Opening, Opened]):
    """The kinds of one part.

    Args:
        what: the part, for messages.
        package: in whose folder they are looked for.

    Attributes:
        known: the kinds that were registered so far, by name.
    """

    def __init__(self, what: str, package: str) -> None:
        self.what, self.package = what, package
        self.known: dict[str, Kind] = {}

    def register(
        self, name: str, settings: type[Settings]
    ) -> Callable[[Callable[[Settings, Opening], Opened]], Callable[[Settings, Opening], Opened]]:
        """Decorator: this function opens parts of that kind. Raises `InputError`: a name that is taken."""

        def add(open_: Callable[[Settings, Opening], Opened]) -> Callable[[Settings, Opening], Opened]:
            if name in self.known:
                raise InputError(f"there is a {self.what} of the kind {name!r} already")
            self.known[name] = Kind(settings, open_)
            return open_

        return add

    def find(self, name: str) -> Kind:
        """A kind by name; `InputError` with the known ones where there is none."""
        if name not in self.known:
            folder = importlib.import_module(self.package).__file__
            assert folder is not None
            for module in pkgutil.iter_modules([str(Path(folder).parent)]):
                importlib.import_module(f"{self.package}.{module.name}")
        if name not in self.known:
            raise InputError(
                f"no {self.what} of the kind {name!r}, known are {', '.join(sorted(self.known))}"
                f"{did_you_mean(name, self.known)}"
            )
        return self.known[name]

    def checked(self, name: str, values: Mapping[str, Any], table: str) -> tuple[Kind, Strict]:
        """A kind and its settings, of the values of a table; `InputError` for an unknown kind, key or value."""
        kind = self.find(name)
        return kind, check(values, kind.settings, table)
