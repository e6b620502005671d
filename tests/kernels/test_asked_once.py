"""Numba's answers are remembered while a kernel is compiled: the code is the same, and Numba is left as it was."""

from __future__ import annotations

import re
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest

from ndtorch.kernels.load import OPTIONS

numba = pytest.importorskip("numba")


def sums() -> Any:
    """A function with one sum in any order, one as it is written, and calls whose types recur."""
    from ndtorch.kernels.inner import exactly, inner

    fast, exact = inner(total), exactly(total)

    def both(lengths: Any, speed: float) -> float:
        kind = lengths.dtype.type
        some = np.empty(lengths.size, lengths.dtype)
        for k in range(lengths.size):
            some[k] = min(max(lengths[k], kind(0)), kind(speed)) + max(lengths[k] * kind(2), kind(1))
        return float(fast(some) + exact(some) + max(fast(lengths), exact(lengths)))

    return both


def total(numbers: Any) -> float:
    out = numbers.dtype.type(0)
    for k in range(numbers.size):
        out += max(numbers[k], out)
    return out  # type: ignore[no-any-return]


def compiled_code() -> tuple[list[str], float]:
    """Of all functions, without the names that Numba numbers, and what it gives."""
    from ndtorch.kernels.cached import compiled
    from ndtorch.kernels.inner import exactly, inner

    inner.cache_clear()
    exactly.cache_clear()
    kernel: Any = compiled(sums(), {**OPTIONS, "no_cfunc_wrapper": True}, keep=False)
    value = kernel(np.linspace(-1, 3, 37, dtype=np.float32), 2.0)
    (result,) = kernel.overloads.values()
    bodies = re.findall(r"^define .*?^}", result.library.get_llvm_str(), re.DOTALL | re.MULTILINE)
    # The wrapper that Python calls has addresses in it.
    code = [re.sub(r"(@|!|%|#)[\w.\"$<>]+", r"\1", body) for body in bodies if "define ptr" not in body]
    return sorted(code), value


def test_the_code_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    from ndtorch.kernels import late

    quick, value = compiled_code()
    monkeypatch.setattr(late, "asked_once", nullcontext)
    usual, other = compiled_code()
    assert any("fadd reassoc" in body for body in quick)
    assert any("fadd float" in body for body in quick)
    assert quick == usual
    assert value == other


def test_a_kind_of_call_is_worked_out_once() -> None:
    from ndtorch.kernels.asked_once import Calls

    asked: list[Any] = []

    class Function:
        """Of Numba's, as far as it matters."""

        _impl_keys: dict[Any, str]

        def __init__(self) -> None:
            self._impl_keys = {}

    class Found:
        """A signature."""

        def __init__(self, given: Any) -> None:
            self.args = given

    def usual(function: Any, context: Any, given: Any, named: Any) -> Any:
        asked.append(given)
        function._impl_keys[given] = f"by {len(asked)}"
        return None if given == ("nothing",) else Found(given)

    resolve, one, other = Calls(usual).method(), Function(), Function()
    first = resolve(one, None, ("int", "int"), {})
    one._impl_keys["int", "int"] = "of another's flags"
    assert resolve(one, None, ("int", "int"), {}) is first
    # What it was found with holds again.
    assert one._impl_keys["int", "int"] == "by 1"
    for function, given, named in (
        (one, ("float", "int"), {}),
        (one, ("int", "int"), {"a": 1}),
        (other, ("int", "int"), {}),
    ):
        assert resolve(function, None, given, named) is not first
    assert len(asked) == 4
    assert resolve(one, None, ("nothing",), {}) is None
    assert resolve(one, None, ("nothing",), {}) is None
    assert len(asked) == 6


def test_calls_under_other_flags_are_others() -> None:
    from numba.core.compiler import Flags
    from numba.core.targetconfig import ConfigStack

    from ndtorch.kernels.asked_once import Calls

    def number(fast: bool) -> int:
        flags: Any = Flags()
        if fast:
            flags.fastmath = {"reassoc"}
        with ConfigStack().enter(flags):
            return calls.number()

    calls = Calls(None)
    assert number(True) == number(True)
    assert number(False) == number(False)
    assert len({number(True), number(False), calls.number()}) == 3


def test_numba_is_left_as_it_was() -> None:
    from llvmlite.binding import ffi
    from numba.core.codegen import CPUCodeLibrary
    from numba.core.cpu import CPUContext
    from numba.core.targetconfig import TargetConfig
    from numba.core.types.functions import BaseFunction

    from ndtorch.kernels.asked_once import asked_once

    def now() -> list[Any]:
        return [
            BaseFunction.get_call_type,
            TargetConfig.values,
            CPUCodeLibrary._optimize_functions,
            CPUContext.create_cfunc_wrapper,
            ffi.lib._lock._cblist,
        ]

    before = now()
    with asked_once():
        assert all(a is not b for a, b in zip(before, now(), strict=True))
    with pytest.raises(ZeroDivisionError), asked_once():
        _ = 1 / 0
    assert all(a is b for a, b in zip(before, now(), strict=True))


def test_options_are_those_of_numba() -> None:
    from numba.core.compiler import Flags

    from ndtorch.kernels.asked_once import values

    flags: Any = Flags()
    assert values(flags) == flags.values()
    flags.nrt, flags.fastmath = True, {"nsz"}
    assert values(flags) == flags.values()
    assert values(flags) != values(Flags())
