"""What counts as a frame, and how it becomes grey."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.errors import InputError
from ndtorch.vision.frames import check_frames, grey


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (np.zeros((1, 3, 4, 4)), r"torch\.Tensor, got ndarray"),
        (torch.zeros(1, 3, 4, 4, dtype=torch.int32), r"uint8, got torch\.int32"),
        (torch.zeros(3, 4, 4), r"\[\.\.\., T, C, H, W\], got \(3, 4, 4\)"),
        (torch.zeros(1, 4, 4, 3), r"3 channels .* got 4"),
        (torch.zeros(1, 2, 4, 4), r"3 channels .* got 2"),
        (torch.zeros(0, 3, 4, 4), r"at least one frame"),
        (torch.zeros(2, 0, 3, 4, 4), r"at least one frame"),
        (torch.zeros(1, 3, 4, 6), r"be 4x5 pixels \(height x width\), got 4x6"),
    ],
)
def test_bad_frames_are_refused_by_name(frames: torch.Tensor, message: str) -> None:
    with pytest.raises(InputError, match=r"^frames must .*" + message):
        check_frames(frames, (4, 5))


def test_grey_is_the_mean_of_the_planes_and_leaves_them_alone() -> None:
    frames = torch.rand(2, 3, 4, 5, dtype=torch.float64)
    before = frames.clone()
    assert_allclose(grey(frames), before.numpy().mean(-3), atol=1e-15)
    assert torch.equal(frames, before)


@pytest.mark.parametrize(("low", "high"), [(0.0, 255.0), (-1.0, 1.0), (0.0, 1.5), (-0.1, 1.0), (0.0, 1.1)])
def test_floats_out_of_range_are_refused(low: float, high: float) -> None:
    frames = torch.linspace(low, high, 2 * 3 * 500 * 4).reshape(2, 3, 500, 4)
    with pytest.raises(InputError, match=f"frames of floats must lie in 0..1, got {low:g} to .*divide by 255"):
        check_frames(frames)
    # A little too much is the interpolation's.
    check_frames(frames.clamp(-0.005, 1.005))
