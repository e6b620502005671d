"""Frames become small pictures: the same ones, however their colors lie in memory, with kernels and without."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.vision.camera.shrunk import shrunk


@pytest.mark.parametrize("size", [(12, 16), (11, 13)])
def test_colors_may_lie_beside_each_other(size: tuple[int, int]) -> None:
    beside = np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8)
    frame = torch.from_numpy(beside).permute(2, 0, 1)
    expected = shrunk(frame.contiguous(), size)
    assert expected.shape == (3, *size)
    assert expected.mean() == pytest.approx(beside.mean() / 255, abs=0.01)
    for quick in (False, True):
        with torch.inference_mode(quick):
            assert np.array_equal(shrunk(frame, size), expected)
    assert np.allclose(shrunk(frame / 255, size), expected, atol=1 / 255)


def test_frames_are_numbers() -> None:
    with pytest.raises(InputError, match="finite"):
        shrunk(torch.full((3, 24, 32), torch.nan), (12, 16))
