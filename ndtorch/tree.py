"""States are nested tuples of tensors: one walk over them for saving, moving, comparing and picking trials."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from torch import Tensor

Tree = TypeVar("Tree")


def leaves(tree: Any, prefix: str = "") -> dict[str, Tensor]:
    """All tensors of a nested tuple by dotted names, `"second.weights"`; parts that are None are left out.

    The parts of a plain tuple are called by their numbers.
    """
    if isinstance(tree, Tensor):
        return {prefix: tree}
    if tree is None:
        return {}
    flat: dict[str, Tensor] = {}
    for name, part in parts(tree):
        flat |= leaves(part, f"{prefix}.{name}" if prefix else name)
    return flat


def mapped(tree: Tree, function: Callable[[str, Tensor], Tensor], prefix: str = "") -> Tree:
    """The same nested tuple of what a function makes of every name and tensor; None stays None."""
    out: Any = tree
    if isinstance(tree, Tensor):
        out = function(prefix, tree)
    elif tree is not None:
        values = [mapped(part, function, f"{prefix}.{name}" if prefix else name) for name, part in parts(tree)]
        out = type(tree)(*values) if hasattr(tree, "_fields") else tuple(values)
    result: Tree = out
    return result


def parts(tree: Any) -> list[tuple[str, Any]]:
    """Names and parts of one tuple."""
    names = tree._fields if hasattr(tree, "_fields") else map(str, range(len(tree)))
    return list(zip(names, tree, strict=True))
