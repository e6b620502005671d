"""References to arrays are counted by plain additions in kernels, and not by such that other threads wait for."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from llvmlite import ir
from llvmlite.binding import parse_assembly
from numba.core.registry import cpu_target
from numba.core.runtime import nrt, nrtdynmod

from ndtorch.kernels.asked_once import replaced

runtime: Any = nrt.rtsys
maker: Any = nrtdynmod


@contextmanager
def counted_plainly() -> Iterator[None]:
    """What is compiled meanwhile counts so. Whoever enters holds Numba's lock.

    A kernel has one thread, and the counts of what it is called with are made for each call: nobody else adds to them.
    Numba counts whenever one function hands a part of an array to another.
    """
    with replaced(runtime, "_library", plain_counts()):
        yield


@cache
def plain_counts() -> Any:
    """Numba's functions that count, which are linked into every kernel."""
    with replaced(maker, "_define_atomic_inc_dec", add_plainly):
        module, library = maker.create_nrt_module(cpu_target.target_context)
    library.add_llvm_module(parse_assembly(re.sub(r"^\s*fence .*$", "", str(module), flags=re.MULTILINE)))
    library.finalize()
    return library


def own(module: Any) -> None:
    """Let a kernel keep its functions that count to itself: what is loaded would else take those that others have."""
    for function in module.functions:
        if function.name in ("NRT_incref", "NRT_decref") and not function.is_declaration:
            function.linkage = "internal"


def add_plainly(module: Any, operation: str, ordering: str) -> Any:
    """A function that adds one to a number, or takes one away, and returns what it is then."""
    word: Any = maker._word_type
    function: Any = ir.Function(module, ir.FunctionType(word, [word.as_pointer()]), name=f"nrt_atomic_{operation}")
    builder: Any = ir.IRBuilder(function.append_basic_block())
    after = getattr(builder, operation)(builder.load(function.args[0]), ir.Constant(word, 1))
    builder.store(after, function.args[0])
    builder.ret(after)
    return function
