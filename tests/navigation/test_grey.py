"""Grey of a row is the sum of its colors, whatever the frame is and wherever the row begins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ndtorch.navigation.stereo._kernels import grey_row

WIDTH = 75


@pytest.mark.parametrize("colors", [1, 3])
@pytest.mark.parametrize("interleaved", [False, True])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_sums_of_colors(dtype: Any, interleaved: bool, colors: int) -> None:
    rng = np.random.default_rng(3)
    numbers = rng.integers(0, 256, (colors, 2, WIDTH))
    planes = numbers.astype(np.uint8) if dtype == np.uint8 else (numbers / 255).astype(np.float32)
    frame = np.ascontiguousarray(planes.transpose(1, 2, 0)) if interleaved else planes
    # One color stands for three.
    scale = 1 / (3 * 255) if dtype == np.uint8 else 1 / 3
    for every in (1, 2, 3):
        for left in (0, 1, 6):
            for y in (0, 1):
                # Up to the last pixel of the row, and of the frame.
                grey = np.full((WIDTH - left + every - 1) // every, np.nan, np.float32)
                grey_row(frame, interleaved, y, left, every, scale, grey)
                np.testing.assert_allclose(grey, numbers[:, y, left::every].mean(0) / 255, rtol=0, atol=1e-6)
