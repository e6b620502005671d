"""Functions that only kernels call: compiled without what Python would need to call them, and once for all kernels."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numba
from numba.core import compiler, cpu, options
from numba.np.unsafe.ndarray import to_fixed_tuple

from ndtorch.kernels.load import FAST

ALONE: Any = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
Flags: Any = compiler.Flags
CPUTargetOptions: Any = cpu.CPUTargetOptions
TargetOptions: Any = options.TargetOptions
tuple_of: Any = to_fixed_tuple
"""The first numbers of an array as a tuple: `tuple_of(array, how many)`."""


@cache
def inner(function: Callable[..., Any]) -> Any:
    """A function with sums in any order, as `FAST` says."""
    return numba.njit(fastmath=FAST, **ALONE)(function)


@cache
def apart(function: Callable[..., Any]) -> Any:
    """A function as `inner` whose arrays do not overlap: so its loops may look up many numbers of one of them at once.

    Numba can tell LLVM so, but offers no option for it. Where it cannot, such loops go number by number.
    """
    return numba.njit(fastmath=FAST, **ALONE, **kept_apart())(function)


@cache
def apart_exactly(function: Callable[..., Any]) -> Any:
    """A function as `exactly` whose arrays do not overlap."""
    return numba.njit(fastmath=False, **ALONE, **kept_apart())(function)


def kept_apart() -> Any:
    """The option that says so, where there can be one."""
    if "noalias" not in Flags.options:
        return {}
    CPUTargetOptions.noalias = TargetOptions.Mapping("noalias")
    return {"noalias": True}


@cache
def exactly(function: Callable[..., Any]) -> Any:
    """A function whose order of operations stays as it is written."""
    # Unless told, Numba would give it the flags of the kernel that calls it.
    return numba.njit(fastmath=False, **ALONE)(function)
