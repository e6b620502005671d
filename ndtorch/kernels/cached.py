"""Numba's cache of compiled functions, without what only compiling needs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.core import caching
from numba.core.runtime.nrt import rtsys

FunctionCache: Any = caching.FunctionCache


class QuickCache(FunctionCache):  # type: ignore[misc]
    """What was compiled before is loaded without the implementations of everything that could be compiled.

    Numba imports those first, SciPy's linear algebra among them, which takes longer than all else. They are imported
    when there is something to compile. Code that is finished needs only the functions that allocate memory.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function of this signature; None where it is not in the cache."""
        rtsys.initialize(target_context)
        return self._load_overload(sig, target_context)


def cached(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """`numba.njit(function, cache=True, **options)` with a `QuickCache`; where it keeps things `numba.config` says."""
    dispatcher: Any = numba.njit(function, **options)
    dispatcher._cache = QuickCache(function)
    return dispatcher
