"""`@jit`: Numba compiles a function at its first call and keeps the machine code in a folder of the user's own."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import pickle
import platform
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from functools import cache, cached_property, partial, update_wrapper
from pathlib import Path
from typing import Any, Generic, TypeVar, overload

import numpy as np

from ndtorch.utils.cache_folder import UnusableFolder, cache_folder, locked, own_files, private_folder, remove_stale

R = TypeVar("R")

FASTMATH = {"reassoc", "contract", "nsz"}
"""LLVM may reorder sums and fuse multiply and add; NaN and infinity keep their meaning."""

log = logging.getLogger("ndtorch.jit")
"""Says at level INFO that functions are compiled because they are not in the cache, and at level DEBUG which."""


class JitFunction(Generic[R]):
    """A function that Numba compiles when it is first called, by Python or while another such function is compiled.

    mypy does not check arguments: Numba takes numbers of any width where the annotation says `int` or `float`.

    Attributes:
        function: as it is written, to call it in plain Python.
    """

    def __init__(self, function: Callable[..., R], exact: bool) -> None:
        self.function, self.exact = function, exact
        self.run: Callable[..., R] = self.first_call
        update_wrapper(self, function)

    def __call__(self, *args: Any) -> R:
        return self.run(*args)

    def __repr__(self) -> str:
        return f"jit({self.function.__module__}.{self.function.__qualname__})"

    @cached_property
    def folder(self) -> Path | None:
        return code_folder(self.function.__module__)

    @cached_property
    def dispatcher(self) -> Any:
        """Numba's function for calls from Python, kept in `folder`."""
        import numba

        config: Any = numba.config
        before = config.CACHE_DIR
        try:
            config.CACHE_DIR = str(self.folder or "")
            made = self.compiler(cache=self.folder is not None)
        finally:
            config.CACHE_DIR = before
        made.compile = partial(self.load_or_compile, made.compile)
        return made

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
        return self.run(*args)

    def load_or_compile(self, compile: Callable[[Any], Any], signature: Any) -> Any:
        """Machine code for arguments of new types.

        One process writes files at a time, since all signatures of a function share an index: the others wait. Files
        that are damaged are deleted and made anew. Where nothing can be written, nothing is kept.
        """
        try:
            with locked(self.folder, self.function.__qualname__):
                return self.keep(compile, signature)
        except OSError:
            self.run = self.dispatcher = self.compiler()
            return self.dispatcher.compile(signature)

    def keep(self, compile: Callable[[Any], Any], signature: Any) -> Any:
        """As `load_or_compile`, by the one process that may write."""
        kept, name = self.files(), self.function.__qualname__
        if not kept:
            announce()
            log.debug("compiling %s", name)
        try:
            if not all(map(is_intact, kept)):
                raise ValueError("damaged")
            code = compile(signature)
        except Exception as error:
            if not kept or isinstance(error, OSError):
                raise
            for file in kept:
                file.unlink(missing_ok=True)
            code = compile(signature)
            warnings.warn(f"the compiled code of {name} in {self.folder} was damaged and is replaced", stacklevel=6)
        for file in self.files():
            seal(file)
        return code

    def files(self) -> list[Path]:
        """What Numba keeps of this function."""
        found = own_files(self.folder) if self.folder is not None else []
        return [file for file in found if file.name.split("-")[0].endswith(f".{self.function.__qualname__}")]


def checksum(file: Path) -> Path:
    return file.with_name(file.name + ".sha256")


def seal(file: Path) -> None:
    """Keep the checksum of machine code. An index is not sealed, since Numba changes it with every new signature."""
    if file.suffix == ".nbc":
        checksum(file).write_text(hashlib.sha256(file.read_bytes()).hexdigest(), encoding="ascii")


def is_intact(file: Path) -> bool:
    """Whether machine code is what it was when it was sealed. What Numba has written since then has no checksum yet."""
    sealed = checksum(file)
    if not sealed.is_file() or sealed.stat().st_mtime_ns < file.stat().st_mtime_ns:
        return True
    return sealed.read_text(errors="replace") == hashlib.sha256(file.read_bytes()).hexdigest()


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


@contextlib.contextmanager
def compiling_beside(work: Callable[[], object], kernel: JitFunction[Any]) -> Iterator[None]:
    """Compile what some work needs in a second process, where `kernel` of it is in no cache yet.

    Numba compiles one function at a time in a process. Who calls one of these functions meanwhile waits for it, and
    compiles itself what the other process did not keep.

    Args:
        work: what needs them, without arguments, of a kind that can be pickled.
    """
    process = None
    if kernel.folder is not None and not kernel.files() and (os.cpu_count() or 1) > 1:
        call = [sys.executable, "-c", "import pickle, sys; pickle.load(sys.stdin.buffer)()"]
        with contextlib.suppress(OSError, pickle.PicklingError, AttributeError), tempfile.TemporaryFile() as given:
            pickle.dump(work, given)
            given.seek(0)
            process = subprocess.Popen(call, stdin=given, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield
    except BaseException:
        if process is not None:
            process.kill()
        raise
    finally:
        if process is not None:
            process.wait()


def packed(numbers: tuple[Any, ...]) -> Any:
    """A NamedTuple of numbers as an array `[1]` of records of the same names.

    Numba takes an array in one step, and a tuple number by number: some .2 us for each at every call.
    """
    kinds = [
        np.bool_ if isinstance(value, bool) else np.int64 if isinstance(value, int) else np.float64 for value in numbers
    ]
    fields: Any = numbers
    return np.array([tuple(numbers)], np.dtype(list(zip(fields._fields, kinds, strict=True)), align=True))


@cache
def announce() -> None:
    """Say once a process that it compiles."""
    log.info("kernels are compiled for this processor, once: it takes about 40 s")


@cache
def register() -> None:
    """Teach Numba what a `JitFunction` is that a compiled function names."""
    from numba.extending import typeof_impl

    @typeof_impl.register(JitFunction)
    def typeof_jit(value: JitFunction[Any], context: Any) -> Any:
        return typeof_impl(value.callee, context)


@cache
def code_folder(module: str) -> Path | None:
    """Private folder for the compiled functions of a module; None where nothing can be kept.

    Its name has the digest of all that the code depends on, of which Numba itself looks at one file only.
    """
    import numba

    digest = hashlib.sha256(f"{numba.__version__} {platform.python_version()} {platform.machine()}".encode())
    for part in sources(module, {}).values():
        digest.update(part)
    try:
        folder = private_folder(cache_folder()) / f"jit-{module}-{digest.hexdigest()[:16]}"
        if not folder.exists():
            remove_stale(folder, f"jit-{module}-*")
        private_folder(folder)
        own_files(folder)
    except (UnusableFolder, OSError):
        return None
    return folder


def sources(module: str, found: dict[str, bytes]) -> dict[str, bytes]:
    """Text and constants of a module and of all modules whose compiled functions it names."""
    if module not in found:
        names = vars(sys.modules[module])
        constants = [f"{name}={value!r}" for name, value in names.items() if name[:2] != "__" and is_constant(value)]
        found[module] = Path(names["__file__"]).read_bytes() + "\n".join(constants).encode()
        for value in list(names.values()):
            if isinstance(value, JitFunction):
                sources(value.function.__module__, found)
    return found


def is_constant(value: object) -> bool:
    if isinstance(value, tuple):
        return all(map(is_constant, value))
    return isinstance(value, int | float | str | np.generic)
