"""Numba's compiler and cache for a kernel, without what a kernel does not need."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.core import caching
from numba.core.runtime import nrt

KNOWN = ("0.68",)
"""Versions of Numba whose inner parts are used here; any other compiles and keeps kernels as it does itself."""

FunctionCache: Any = caching.FunctionCache


class QuickCache(FunctionCache):  # type: ignore[misc]
    """What was compiled before is loaded without the implementations of everything that could be compiled.

    Numba imports those first, SciPy's linear algebra among them, which takes longer than all else. They are imported
    when there is something to compile. Code that is finished needs only the functions that allocate memory.
    """

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
