"""Parts of a kernel keep their own rules about the order of sums, whatever the kernel's are."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from ndtorch.kernels.load import OPTIONS

numba = pytest.importorskip("numba")


def total(numbers: Any) -> Any:
    """A sum from left to right."""
    out = numbers.dtype.type(0)
    for k in range(numbers.size):
        out += numbers[k]
    return out


@pytest.mark.parametrize("exact", [True, False])
def test_an_exact_part_keeps_its_order(exact: bool) -> None:
    from ndtorch.kernels.cached import compiled
    from ndtorch.kernels.inner import exactly, inner

    part = (exactly if exact else inner)(total)

    def whole(numbers: Any) -> float:
        return float(part(numbers))

    kernel: Any = compiled(whole, OPTIONS, keep=False)
    assert kernel(np.arange(5, dtype=np.float32)) == 10
    (result,) = kernel.overloads.values()
    sums = re.findall(r"= fadd ([^%]*?)(?:float|<)", result.library.get_llvm_str())
    assert sums
    assert any("reassoc" in each for each in sums) is not exact
