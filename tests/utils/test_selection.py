"""Order statistics by a compiled function are those of a sorted list."""

from __future__ import annotations

import numpy as np

from ndtorch.utils.selection import median, quickselect


def test_medians_and_places_of_many_few_and_equal_numbers() -> None:
    chance = np.random.default_rng(3)
    some = [chance.random(900), chance.integers(0, 4, 900), np.ones(900), np.arange(900), -np.arange(900.0)]
    rows = [*some, np.exp(9 * chance.standard_normal(900))]
    numbers = np.repeat(np.array(rows, np.float32), 60, 0)
    counts, before = chance.integers(1, 901, len(numbers)), numbers.copy()
    for row, count in zip(numbers, counts.tolist(), strict=True):
        n = count // 3
        assert np.float32(median(row, count)) == np.median(row[:count])
        assert np.float32(quickselect(row, count, n)) == np.sort(row[:count])[n]
    assert np.array_equal(numbers, before)
