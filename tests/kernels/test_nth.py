"""Medians by a kernel are those of a sorted list."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ndtorch.kernels.load import OPTIONS

pytest.importorskip("numba")


def test_medians_of_many_few_and_equal_numbers() -> None:
    import numba

    from ndtorch.kernels.nth import middle_of

    def each(rows: Any, counts: Any, found: Any) -> None:
        for k in range(counts.size):
            found[k] = middle_of(rows[k], counts[k])

    chance = np.random.default_rng(3)
    some = [chance.random(900), chance.integers(0, 4, 900), np.ones(900), np.arange(900), -np.arange(900.0)]
    rows = [*some, np.exp(9 * chance.standard_normal(900))]
    numbers = np.repeat(np.array(rows, np.float32), 60, 0)
    counts, found = chance.integers(1, 901, len(numbers)), np.empty(len(numbers), np.float32)
    before = numbers.copy()
    numba.njit(each, **OPTIONS)(numbers, counts, found)
    expected = [np.median(row[:count]) for row, count in zip(numbers, counts, strict=True)]
    assert np.array_equal(found, np.array(expected, np.float32))
    assert np.array_equal(numbers, before)
