"""Parts by name: in a dictionary, or one a file in a folder, found when they are first asked for."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from typing import TypeVar

from ndtorch.errors import InputError, did_you_mean

Part = TypeVar("Part")


class Registry(dict[str, Part]):
    """The parts of a kind by name.

    Args:
        what: the kind, for messages: "controller".
        package: in whose modules more parts register themselves, imported when an unknown name is asked for.

    >>> rules = Registry[int]("rule")
    >>> rules.register("one")(1), rules.find("one")
    (1, 1)
    """

    def __init__(self, what: str, package: str | None = None) -> None:
        super().__init__()
        self.what, self.package = what, package

    def register(self, name: str) -> Callable[[Part], Part]:
        """Decorator: this part has that name. Raises `InputError`: it is taken."""

        def add(part: Part) -> Part:
            if self.setdefault(name, part) is not part:
                raise InputError(f"there is a {self.what} {name!r} already")
            return part

        return add

    def load(self) -> Registry[Part]:
        """This, with all parts of the package."""
        for module in pkgutil.iter_modules(importlib.import_module(self.package).__path__) if self.package else ():
            importlib.import_module(f"{self.package}.{module.name}")
        return self

    def find(self, name: str) -> Part:
        """A part by name; raises `InputError` with the known ones where there is none."""
        if name not in self and name not in self.load():
            known = sorted(self)
            raise InputError(f"{self.what} must be one of {', '.join(known)}, got {name!r}{did_you_mean(name, known)}")
        return self[name]
