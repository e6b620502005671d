"""Parts by name, such as drive links and bridges: each kind is a table of settings and a function that opens it."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from ndtorch.errors import InputError, did_you_mean
from ndtorch.utils.toml import Strict, check

Function = TypeVar("Function", bound=Callable[..., Any])


class Kind(NamedTuple):
    """A kind of part: the table of its settings, and what opens it, called with settings and an opening."""

    settings: type[Strict]
    open: Callable[[Any, Any], Any]


class Kinds(dict[str, Kind]):
    """The kinds of one part by name; those of its package are imported when a name is not known.

    Args:
        what: the part, for messages.
        package: name of the package whose modules register kinds.
    """

    def __init__(self, what: str, package: str) -> None:
        super().__init__()
        self.what, self.package = what, package

    def register(self, name: str, settings: type[Strict]) -> Callable[[Function], Function]:
        """Decorator: this function opens parts of that kind. Raises `InputError`: a name that is taken."""

        def add(function: Function) -> Function:
            if name in self:
                raise InputError(f"there is a {self.what} of the kind {name!r} already")
            self[name] = Kind(settings, function)
            return function

        return add

    def checked(self, name: str, values: Mapping[str, Any], table: str) -> tuple[Kind, Strict]:
        """A kind and its settings, of the values of a table; `InputError` for an unknown kind, key or value."""
        if name not in self:
            folder = str(Path(importlib.import_module(self.package).__file__ or "").parent)
            for module in pkgutil.iter_modules([folder]):
                importlib.import_module(f"{self.package}.{module.name}")
        if name not in self:
            known = f"known are {', '.join(sorted(self))}{did_you_mean(name, self)}"
            raise InputError(f"no {self.what} of the kind {name!r}, {known}")
        return self[name], check(values, self[name].settings, table)
