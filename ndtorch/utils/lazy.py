"""Public names that are imported when they are first used, so that a command line can answer before torch is there."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any


def lazy(
    package: str,
    rooms: Sequence[str] = (),
    moved: Mapping[str, str] | None = None,
    explain: bool = False,
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """The `__getattr__` and `__dir__` of a package that imports what stands under its `if TYPE_CHECKING` when asked.

    Args:
        package: `__name__` of the package.
        rooms: sub-packages and modules that are there without an import of their own.
        moved: names that are no more, and what takes their place.
        explain: whether calls explain wrong arguments, see `ndtorch.utils.public_calls`.

    Returns:
        What gives a name its value, and raises AttributeError for a name that is not public; and what lists them.
    """
    text = Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8")
    checked = [block for block in ast.parse(text).body if isinstance(block, ast.If) and not block.orelse]
    imports = [node for block in checked for node in block.body if isinstance(node, ast.ImportFrom)]
    module_of = {alias.name: str(node.module) for node in imports for alias in node.names}

    def attribute(name: str) -> Any:
        if name in module_of:
            value = getattr(import_module(module_of[name]), name)
            return import_module("ndtorch.utils.public_calls").explained(value) if explain else value
        if name in rooms:
            return import_module(f"{package}.{name}")
        if moved is not None and name in moved:
            # An AttributeError would be told by `from ... import` in other words.
            raise ImportError(f"{package}.{name} is gone; use {moved[name]}")
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return attribute, lambda: sorted({*sys.modules[package].__all__, *rooms})
