"""Nested tuples of tensors, and the memory that tensors leave behind."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from ndtorch.errors import InputError

Tree = TypeVar("Tree")
Kind = TypeVar("Kind", bound=type)


def safe_state(kind: Kind) -> Kind:
    """Decorator of the class of a state: `torch.load` reads it with `weights_only=True`, its default."""
    torch.serialization.add_safe_globals([kind])
    return kind


def leaves(tree: Any, prefix: str = "") -> dict[str, Tensor]:
    """All tensors, arrays and numbers of a nested tuple by dotted names, `"second.weights"`; None is left out.

    The parts of a plain tuple are called by their numbers.
    """
    flat: dict[str, Tensor] = {}

    def keep(name: str, tensor: Tensor) -> Tensor:
        flat[name] = tensor
        return tensor

    mapped(tree, keep, prefix)
    return flat


def mapped(tree: Tree, function: Callable[[str, Tensor], Tensor], prefix: str = "") -> Tree:
    """The same nested tuple of what a function makes of every name and tensor; None stays None.

    Arrays and numbers are given to the function as tensors, and become arrays and numbers again.
    """
    out: Any = tree
    if isinstance(tree, Tensor):
        out = function(prefix, tree)
    elif isinstance(tree, np.ndarray):
        out = function(prefix, torch.as_tensor(tree)).numpy()
    elif isinstance(tree, np.generic | int | float):
        kind: Any = type(tree)
        out = kind(function(prefix, torch.as_tensor(tree)).item())
    elif tree is not None:
        values = [mapped(part, function, f"{prefix}.{name}" if prefix else name) for name, part in parts(tree)]
        out = type(tree)(*values) if hasattr(tree, "_fields") else tuple(values)
    result: Tree = out
    return result


def parts(tree: Any) -> list[tuple[str, Any]]:
    """Names and parts of one tuple."""
    if not isinstance(tree, tuple | list):
        raise InputError(f"state must be a nested tuple of tensors, got {type(tree).__name__}")
    names = tree._fields if hasattr(tree, "_fields") else map(str, range(len(tree)))
    return list(zip(names, tree, strict=True))


def keep_freed_memory() -> None:
    """Make the C library reuse freed image-sized memory instead of handing it back to the system.

    A 500x500 plane takes 1 MB, and fresh memory costs a page fault every 4 KiB, several times the price of a
    pass over the plane. glibc raises its limits for handing memory back to the size of the largest block freed so far,
    up to 32 MiB; one block that is never touched is enough. Elsewhere this does nothing. It takes microseconds.
    """
    torch.empty(31 << 20, dtype=torch.uint8)


def tune_allocator() -> None:
    """For programs: one pool of memory for all threads, given back only when asked. A quarter faster with pictures.

    Where the C library has no `mallopt` (it is glibc's), nothing happens.
    """
    tune = getattr(ctypes.CDLL(None), "mallopt", None)
    if tune is not None:
        arena_max, trim_threshold, mmap_threshold = -8, -1, -3
        tune(arena_max, 1)
        tune(trim_threshold, 512 << 20)
        tune(mmap_threshold, 32 << 20)
