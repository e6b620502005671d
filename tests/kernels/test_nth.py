"""Medians by a kernel are those of a sorted list."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.nth import middle_of


def test_medians_of_many_few_and_equal_numbers() -> None:
    chance = np.random.default_rng(3)
    some = [chance.random(900), chance.integers(0, 4, 900), np.ones(900), np.arange(900), -np.arange(900.0)]
    rows = [*some, np.exp(9 * chance.standard_normal(900))]
    numbers = np.repeat(np.array(rows, np.float32), 60, 0)
    counts, before = chance.integers(1, 901, len(numbers)), numbers.copy()
    found = [middle_of(row, count) for row, count in zip(numbers, counts, strict=True)]
    expected = [np.median(row[:count]) for row, count in zip(numbers, counts, strict=True)]
    assert np.array_equal(np.array(found, np.float32), np.array(expected, np.float32))
    assert np.array_equal(numbers, before)
