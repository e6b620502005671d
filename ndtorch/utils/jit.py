"""`@jit`: Numba compiles a function at its first call and keeps the machine code in a folder of the user's own.

Numba's cache looks at the file of a function alone. Here the folder's name has a digest of the files and constants of
all compiled functions that a module names, so that a change in one compiles its callers again.
"""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import stat
import sys
import time
from collections.abc import Callable
from functools import cache, cached_property, update_wrapper
from pathlib import Path
from typing import Any, Generic, TypeVar, overload

import numpy as np

R = TypeVar("R")

FASTMATH = {"reassoc", "contract", "nsz"}
"""LLVM may reorder sums and fuse multiply and add; NaN and infinity keep their meaning."""

SLOW_S = 1.0
"""Kernels that took longer to compile are logged one by one."""

log = logging.getLogger("ndtorch.jit")


class JitFunction(Generic[R]):
    """A function that Numba compiles when it is first called, by Python or while another such function is compiled.

    mypy does not check arguments: Numba takes numbers of any width where the annotation says `int` or `float`.

    Attributes:
        function: as it is written, to call it in plain Python.
        run: the same as calling it, without a step in between once it is compiled.
    """

    def __init__(self, function: Callable[..., R], exact: bool) -> None:
        self.function, self.exact = function, exact
        self.run: Callable[..., R] = self.first_call
        update_wrapper(self, function)

    def __call__(self, *args: Any) -> R:
        return self.run(*args)

    @cached_property
    def folder(self) -> Path | None:
        return code_folder(self.function.__module__)

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's function for calls from Python, kept in `folder`."""
        import numba

        config: Any = numba.config
        before, config.CACHE_DIR = config.CACHE_DIR, str(self.folder or "")
        try:
            return self.compiler(cache=self.folder is not None)
        finally:
            config.CACHE_DIR = before

    @cached_property
    def callee(self) -> Any:
        """Numba's function for calls from other compiled functions, whose code contains it.

        Python cannot call it: the wrapper for that would take a fifth of the time to compile.
        """
        return self.compiler(no_cpython_wrapper=True, no_cfunc_wrapper=True)

    def compiler(self, **options: Any) -> Any:
        import numba

        register()
        fastmath = False if self.exact else FASTMATH
        return numba.njit(nogil=True, error_model="numpy", fastmath=fastmath, **options)(self.function)

    def first_call(self, *args: Any) -> R:
        self.run = self.dispatcher
        if self.folder is not None and any(self.folder.rglob(f"*.{self.function.__qualname__}-*.nbi")):
            return self.run(*args)
        announce()
        began = time.perf_counter()
        result = self.run(*args)
        seconds = time.perf_counter() - began
        if seconds > SLOW_S:
            log.info("kernel %s compiled in %.1f s", self.function.__qualname__, seconds)
        return result


@overload
def jit(function: Callable[..., R], *, exact: bool = False) -> JitFunction[R]: ...
@overload
def jit(function: None = None, *, exact: bool = False) -> Callable[[Callable[..., R]], JitFunction[R]]: ...
def jit(function: Callable[..., R] | None = None, *, exact: bool = False) -> Any:
    """Compile a function of numbers, arrays and NamedTuples at its first call.

    Args:
        exact: the order of operations stays as it is written; else sums may be reordered (`FASTMATH`).
    """
    return JitFunction(function, exact) if function is not None else lambda given: JitFunction(given, exact)


@cache
def announce() -> None:
    """Say once a process that it compiles."""
    log.info("kernels are compiled for this processor, once: about 40 s; `ndtorch doctor --prepare` compiles all")


@cache
def register() -> None:
    """Teach Numba what a `JitFunction` is that a compiled function names."""
    from numba.extending import typeof_impl

    @typeof_impl.register(JitFunction)
    def typeof_jit(value: JitFunction[Any], context: Any) -> Any:
        return typeof_impl(value.callee, context)


def cache_folder() -> Path | None:
    """`ndtorch` in `$XDG_CACHE_HOME` or `~/.cache`; None where there is no home."""
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ndtorch"
    except RuntimeError:
        return None


@cache
def code_folder(module: str) -> Path | None:
    """Folder for the compiled functions of a module; None where nothing can be kept.

    Machine code runs as the user: the folder is made for its owner alone, and one of another owner is not used.
    """
    import numba

    digest = hashlib.sha256(f"{numba.__version__} {platform.python_version()} {platform.machine()}".encode())
    for text in sources(module, {}).values():
        digest.update(text)
    root = cache_folder()
    if root is None:
        return None
    folder = root / f"jit-{module}-{digest.hexdigest()[:16]}"
    return folder if make_private(root) and make_private(folder) else None


def make_private(folder: Path) -> bool:
    """Make a folder for its owner alone; False where that cannot be, or where it is another user's."""
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        state = folder.stat()
        if state.st_uid == os.getuid() and stat.S_IMODE(state.st_mode) != 0o700:
            folder.chmod(0o700)
        return state.st_uid == os.getuid() and os.access(folder, os.R_OK | os.W_OK | os.X_OK)
    except OSError:
        return False


def sources(module: str, read: dict[str, bytes]) -> dict[str, bytes]:
    """Text and constants of a module and of all modules whose compiled functions it names."""
    if module not in read:
        names = vars(sys.modules[module])
        constants = [f"{name}={value!r}" for name, value in names.items() if name[:2] != "__" and is_constant(value)]
        read[module] = Path(names["__file__"]).read_bytes() + "\n".join(constants).encode()
        for value in list(names.values()):
            if isinstance(value, JitFunction):
                sources(value.function.__module__, read)
    return read


def is_constant(value: object) -> bool:
    if isinstance(value, tuple):
        return all(map(is_constant, value))
    return isinstance(value, int | float | str | np.generic)
