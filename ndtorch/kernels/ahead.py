"""Memory that is soon needed is asked for ahead, so that nobody waits for it."""

from __future__ import annotations

from typing import Any

import numba
import numba.extending
import numpy as np
from llvmlite import ir
from numba import types

from ndtorch.kernels.inner import inner

Array = Any
Place = Any

LINE = 64
"""Bytes that come at once."""


@inner
def ask_for(numbers: Array, start: Place, count: int) -> None:
    """Have so many numbers of an array without gaps near, from a place on, counted from its first one.

    What lies beyond the array is asked for without harm.
    """
    for k in range(0, count, LINE // numbers.itemsize):
        ask(numbers, start + np.uintp(k))


def ask_of(typing: Any, numbers: Any, place: Any) -> Any:
    """Tell the processor that a number will be read."""

    def make(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        data = context.make_array(numbers)(context, builder, given[0]).data
        number, byte = ir.IntType(32), ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        tell: Any = builder.module.globals.get("llvm.prefetch.p0i8")
        tell = tell or ir.Function(builder.module, kind, "llvm.prefetch.p0i8")
        where = builder.bitcast(builder.gep(data, [given[1]]), byte)
        # To be read, into all caches but the nearest, of data.
        builder.call(tell, [where, number(0), number(2), number(1)])
        return context.get_dummy_value()

    return types.none(numbers, types.uintp), make


ask: Any = numba.extending.intrinsic(ask_of)
