"""Public names that are imported when they are first used, so that a command line answers before torch is there."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any


def lazy(package: str, submodules: Sequence[str] = ()) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """The `__getattr__` and `__dir__` (PEP 562) of a package that imports when asked what stands under its
    `if TYPE_CHECKING`.

    Args:
        package: `__name__` of the package.
        submodules: those that can be named without an import of their own.
    """
    text = Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8")
    checked = [block for block in ast.parse(text).body if isinstance(block, ast.If) and not block.orelse]
    imports = [node for block in checked for node in block.body if isinstance(node, ast.ImportFrom)]
    module_of = {alias.name: str(node.module) for node in imports for alias in node.names}

    def attribute(name: str) -> Any:
        if name in module_of:
            return getattr(import_module(module_of[name]), name)
        if name in submodules:
            return import_module(f"{package}.{name}")
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return attribute, lambda: sorted({*sys.modules[package].__all__, *submodules})
