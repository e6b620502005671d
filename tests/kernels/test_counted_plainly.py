"""Kernels count references without locks, free what they made, and leave what they were given as it was."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ndtorch.kernels.load import OPTIONS

numba = pytest.importorskip("numba")


def doubled(rows: Any, out: Any) -> None:
    """A function that is given parts of arrays."""
    for k in range(out.size):
        out[k] = rows[k] + rows[k]


def kernel_of(part: Any) -> Any:
    """What hands parts of arrays to a function, its own and such as it was given, and returns one of its own."""

    def whole(given: Any) -> Any:
        made = np.empty((2, given.size), given.dtype)
        part(given, made[0])
        part(made[0], made[1])
        return made[1]

    return whole


@pytest.fixture(params=["in_line", "called"])
def kernel(request: pytest.FixtureRequest) -> Any:
    """Whether the function becomes a part of the kernel or stays one that is called."""
    from ndtorch.kernels.cached import compiled

    part = numba.njit(forceinline=request.param == "in_line", no_cpython_wrapper=True)(doubled)
    return compiled(kernel_of(part), OPTIONS, keep=False)


def test_no_locks(kernel: Any) -> None:
    np.testing.assert_array_equal(kernel(np.arange(5.0)), 4 * np.arange(5.0))
    (result,) = kernel.overloads.values()
    code = result.library.get_llvm_str()
    assert "NRT_decref" in code
    assert "atomicrmw" not in code
    assert "define internal void @NRT_decref" in code.replace("define internal fastcc void", "define internal void")


def test_others_count_as_before(kernel: Any) -> None:
    kernel(np.arange(5.0))

    @numba.njit
    def usual(given: Any) -> Any:
        return given.copy()

    usual(np.arange(5.0))
    (result,) = usual.overloads.values()
    assert "atomicrmw" in result.library.get_llvm_str()


def test_everything_is_freed_once(kernel: Any) -> None:
    given = np.arange(2000.0)
    kernel(given)
    held = sys.getrefcount(given)
    status = Path("/proc/self/statm")
    kept = [kernel(given) for _ in range(50)]
    assert sys.getrefcount(given) == held
    assert all(np.array_equal(each, 4 * given) for each in kept)
    if not status.exists():
        return
    # Arrays of 32 kB each, 100 MB of them.
    before = int(status.read_text().split()[1])
    for _ in range(3000):
        kernel(given)
    assert (int(status.read_text().split()[1]) - before) * 4096 < 20e6
