"""Numba's compiler and cache for a kernel, without what a kernel does not need."""

from __future__ import annotations

import hashlib
import pickle
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import caching
from numba.core.runtime import nrt

KNOWN = ("0.68",)
"""Versions of Numba whose inner parts are used here; any other compiles and keeps kernels as it does itself."""

FunctionCache: Any = caching.FunctionCache
CacheFile: Any = caching.IndexDataCacheFile

DIGEST = hashlib.sha256().digest_size


class CheckedFile(CacheFile):  # type: ignore[misc]
    """The files of a kernel, each with a checksum before its content: damaged native code is never loaded.

    A damaged index counts as empty, and a damaged file as not there: the kernel is compiled again, and what is kept is
    written anew. This is said in one line.
    """

    def _load_index(self) -> dict[Any, str]:
        path = Path(self._index_path)
        content = unspoiled(path) if path.is_file() else None
        if content is None:
            return {}
        version, stamp, overloads = pickle.loads(content)
        return overloads if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, self._dump((self._version, self._source_stamp, overloads)))

    def _load_data(self, name: str) -> Any:
        content = unspoiled(Path(self._data_path(name)))
        return None if content is None else pickle.loads(content)

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), self._dump(data))

    def _write(self, path: str, content: bytes) -> None:
        with self._open_for_write(path) as file:
            file.write(hashlib.sha256(content).digest() + content)


def unspoiled(path: Path) -> bytes | None:
    """What a file holds after its checksum; None, and a warning, where that does not fit.

    Raises:
        OSError: it cannot be read.
    """
    content = path.read_bytes()
    if hashlib.sha256(content[DIGEST:]).digest() == content[:DIGEST]:
        return content[DIGEST:]
    warnings.warn(f"the compiled code in {path} is damaged: it is compiled again", stacklevel=2)
    return None


class QuickCache(FunctionCache):  # type: ignore[misc]
    """What was compiled before is loaded without the implementations of everything that could be compiled.

    Numba imports those first, SciPy's linear algebra among them, which takes longer than all else. They are imported
    when there is something to compile. Code that is finished needs only the functions that allocate memory.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = CheckedFile(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=self._impl.locator.get_source_stamp(),
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function of this signature; None where it is not in the cache."""
        runtime: Any = nrt.rtsys
        runtime.initialize(target_context)
        return self._load_overload(sig, target_context)


def compiled(function: Callable[..., Any], options: dict[str, Any], keep: bool) -> Any:
    """`numba.njit(function, cache=keep, **options)`: where it keeps things `numba.config` says."""
    if not numba.__version__.startswith(KNOWN):
        return numba.njit(function, cache=keep, **options)
    dispatcher: Any = numba.njit(function, **options)
    if keep:
        dispatcher._cache = QuickCache(function)
    compiler = dispatcher._compiler
    usual = compiler.compile

    def compile_once(args: Any, return_type: Any) -> Any:
        from ndtorch.kernels.late import optimised_once

        with optimised_once(function.__qualname__):
            return usual(args, return_type)

    compiler.compile = compile_once
    return dispatcher
