"""Asking for memory ahead changes nothing, wherever it lies."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ndtorch.kernels.load import OPTIONS

numba = pytest.importorskip("numba")


@pytest.mark.parametrize("dtype", [np.uint8, np.float64])
def test_memory_is_asked_for_line_by_line(dtype: Any) -> None:
    from ndtorch.kernels.ahead import ask_for
    from ndtorch.kernels.cached import compiled

    def work(numbers: Any, start: int, count: int) -> Any:
        ask_for(numbers, np.uintp(start), count)
        return numbers.sum()

    kernel: Any = compiled(work, OPTIONS, keep=False)
    numbers = np.arange(300).reshape(3, 100).astype(dtype)
    before = numbers.copy()
    # The last two places are beyond the array, the last one far beyond all memory of the process.
    for start, count in ((0, 300), (250, 50), (0, 0), (290, 100_000), (1 << 55, 300)):
        assert kernel(numbers, start, count) == before.sum()
    np.testing.assert_array_equal(numbers, before)
    (result,) = kernel.overloads.values()
    assert "llvm.prefetch" in result.library.get_llvm_str()
