"""Frames become small pictures: the same ones, however their colors lie in memory."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch

from ndtorch.foreground.downscale import downscale


@pytest.mark.parametrize("size", [(12, 16), (11, 13)])
def test_colors_may_lie_beside_each_other(size: tuple[int, int]) -> None:
    beside = np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8)
    frame = torch.from_numpy(beside).permute(2, 0, 1)
    expected = downscale(frame.contiguous(), size)
    assert expected.shape == (3, *size)
    assert expected.mean() == pytest.approx(beside.mean() / 255, abs=0.01)
    assert np.array_equal(downscale(frame, size), expected)
    assert np.allclose(downscale(frame / 255, size), expected, atol=1 / 255)


def test_a_halved_frame_is_that_of_opencv() -> None:
    image = np.random.default_rng(5).integers(0, 256, (26, 38, 3)).astype(np.uint8)
    expected = np.asarray(cv2.resize(image, (19, 13), interpolation=cv2.INTER_AREA)).transpose(2, 0, 1)
    found = downscale(torch.from_numpy(image).permute(2, 0, 1), (13, 19))
    assert np.array_equal(found, expected * np.float32(1 / 255))
