"""Compiled kernels by name: taken from the cache, or compiled once and kept there."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable, Hashable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from ndtorch.kernels.folder import UnusableFolder, cache_folder, locked, private_folder, remove_stale

FAST = {"reassoc", "contract", "nsz"}
"""Sums may be taken in any order, and a product be added in one operation; NaN and infinity stay what they are."""

OPTIONS: dict[str, Any] = {"nogil": True, "fastmath": FAST, "error_model": "numpy"}
"""How Numba compiles a kernel."""


class Kernel:
    """A kernel for one kind of arguments. Call `run`; the first call takes it from the cache or compiles it."""

    def __init__(self, name: str, dispatcher: Callable[..., Any], folder: Path | None) -> None:
        self.name, self.dispatcher, self.folder = name, dispatcher, folder
        self.run: Callable[..., Any] = self.first

    def first(self, *given: Any) -> Any:
        """Two processes that write one kernel at once could mix up its entries: one after the other."""
        with locked(self.folder, self.name):
            out = self.dispatcher(*given)
        self.run = self.dispatcher
        return out


@cache
def kernel(name: str, kind: Hashable = None) -> Kernel:
    """The kernel in the file of this name.

    Args:
        kind: of its arguments, such as their dtypes; every kind is compiled once.
    """
    import numba

    from ndtorch.kernels.cached import compiled

    config: Any = numba.config
    function = getattr(import_module(f"ndtorch.kernels.{name}"), name)
    folder = code_folder(numba.__version__)
    before = config.CACHE_DIR
    try:
        config.CACHE_DIR = "" if folder is None else str(folder)
        dispatcher = compiled(function, OPTIONS, keep=folder is not None)
    finally:
        config.CACHE_DIR = before
    return Kernel(name, dispatcher, folder)


@cache
def code_folder(numba_version: str) -> Path | None:
    """The private folder for what these very files become with this Numba and Python; None where nothing can be kept.

    Numba looks at a kernel's own file, not at what that file uses: so the name of the folder stands for all of them.
    """
    digest = hashlib.sha256(f"{numba_version} {platform.python_version()} {platform.machine()}".encode())
    for file in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(file.read_bytes())
    try:
        folder = private_folder(cache_folder()) / f"kernels-{digest.hexdigest()[:16]}"
        if not folder.exists():
            remove_stale(folder, "kernels-*")
        return private_folder(folder)
    except (UnusableFolder, OSError):
        return None
