"""Regions of what stands out: those that hang together by little are cut."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ndtorch.binding.tracking.regions import parted, regions_of


def test_two_that_touch_side_by_side_are_cut_and_one_alone_is_not() -> None:
    picture = np.zeros((60, 80), bool)
    picture[10:40, 5:15] = True
    picture[12:40, 18:27] = True
    picture[35:40, 15:18] = True
    # One with a narrow neck, and a thing with a little one at its side.
    picture[44:48, 40:46] = True
    picture[48:58, 38:50] = True
    picture[10:40, 60:74] = True
    picture[30:32, 74:80] = True
    before = regions_of(picture, 10, 0)
    assert sorted(before.areas.tolist()) == [144, 432, 567]
    after = parted(before, 0.7, 10)
    neck, one, other, alone = sorted(after.areas.tolist())
    assert (neck, one + other, alone) == (144, 567, 432)
    # Both have their height, and what joined them goes to either.
    assert 252 <= one <= 267
    for r, (top, left, bottom, right) in enumerate(after.boxes.tolist()):
        rows, columns = np.nonzero(after.labels == r + 1)
        assert len(rows) == after.areas[r]
        assert (rows.min(), columns.min(), rows.max() + 1, columns.max() + 1) == (top, left, bottom, right)
    # What was given is as it was.
    assert (before.labels == regions_of(picture, 10, 0).labels).all()
    assert len(parted(before, 0.0, 10).areas) == 3


def test_kernels_find_and_cut_what_opencv_and_numpy_do() -> None:
    pytest.importorskip("numba")
    cv2 = pytest.importorskip("cv2")
    chance, cuts = np.random.default_rng(5), 0
    for trial in range(200):
        height, width = chance.integers(1, 50, 2)
        smooth = cv2.blur(chance.random((height, width)), tuple(int(side) for side in chance.integers(1, 9, 2)))
        figure = smooth.reshape(height, width) > chance.uniform(0.3, 0.7)
        # With holes, islands in holes, and what hangs together by a corner.
        gap = trial % 3
        plain = regions_of(figure, 2, gap)
        parts = parted(plain, 0.8, 2)
        with torch.inference_mode():
            quick = regions_of(figure, 2, gap)
            quick_parts = parted(quick, 0.8, 2)
        for one, other in zip((*plain, *parts), (*quick, *quick_parts), strict=True):
            assert np.array_equal(one, other)
        cuts += len(parts.areas) - len(plain.areas)
    assert cuts > 20
