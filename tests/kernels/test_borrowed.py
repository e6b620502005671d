"""References to arguments are not counted, and arrays that a kernel makes are still given back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ndtorch.kernels.load import OPTIONS

numba = pytest.importorskip("numba")


def shorter(numbers: Any, other: Any, turn: int) -> Any:
    """An argument that becomes something else, and one that is given back."""
    for k in range(turn):
        numbers = numbers[1:] if k % 2 == 0 else numbers.copy()
    return numbers if turn > 2 else other


def pair(one: Any, other: Any) -> Any:
    return one, other


def kernel() -> tuple[Any, Any]:
    """A kernel of those, and its compiled code."""
    from ndtorch.kernels.cached import compiled
    from ndtorch.kernels.inner import inner

    inner.cache_clear()
    part, both = inner(shorter), inner(pair)

    def work(numbers: Any, turns: int) -> float:
        out = 0.0
        for turn in range(turns):
            made = np.full(numbers.size + turn, 2.0)
            left, right = both(part(numbers, made, turn), part(made, numbers, turn))
            out += left[0] + 100 * right[-1] + 10000 * part(left, right[1:], 5).size
        return out

    run = compiled(work, OPTIONS, keep=False)
    run(np.arange(9.0), 1)
    (result,) = run.overloads.values()
    return run, result.library.get_llvm_str()


def plainly(numbers: np.ndarray, turns: int) -> float:
    out = 0.0
    for turn in range(turns):
        made = np.full(numbers.size + turn, 2.0)
        left, right = pair(shorter(numbers, made, turn), shorter(made, numbers, turn))
        out += left[0] + 100 * right[-1] + 10000 * shorter(left, right[1:], 5).size
    return float(out)


def test_nothing_is_lost_and_nothing_given_back_twice() -> None:
    from numba.core.runtime import _nrt_python, rtsys

    run, _ = kernel()
    numbers = np.arange(9.0)
    runtime: Any = rtsys
    counts: Any = _nrt_python
    counts.memsys_enable_stats()
    try:
        before = runtime.get_allocation_stats()
        for turns in range(1, 6):
            assert run(numbers, turns) == plainly(numbers, turns)
        after = runtime.get_allocation_stats()
    finally:
        counts.memsys_disable_stats()
    assert after.mi_alloc - before.mi_alloc == after.mi_free - before.mi_free > 15
    np.testing.assert_array_equal(numbers, np.arange(9.0))


def test_fewer_references_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    from contextlib import nullcontext

    from ndtorch.kernels import late

    def counted(code: str) -> int:
        return code.count("@NRT_incref(") + code.count("@NRT_decref(")

    _, quick = kernel()
    monkeypatch.setattr(late, "borrowed", nullcontext)
    _, usual = kernel()
    assert counted(quick) < counted(usual)


def test_numba_is_left_as_it_was() -> None:
    from numba.core.lowering import Lower

    from ndtorch.kernels.borrowed import borrowed

    before = Lower.lower_assign, Lower.delvar
    with borrowed():
        assert Lower.lower_assign is not before[0]
        assert Lower.delvar is not before[1]
    with pytest.raises(ZeroDivisionError), borrowed():
        _ = 1 / 0
    assert (Lower.lower_assign, Lower.delvar) == before
