"""Hassenstein-Reichardt detectors against explicit loops, and their conventions of direction."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.vision import HassensteinReichardt
from ndtorch.vision.motion import BORDERS, Border
from tests.strategies import noise

LEFT, RIGHT, DOWN, UP = range(4)


def reference(frames: np.ndarray, dt: float, tau_high: float, tau_low: float, border: str) -> np.ndarray:
    """[B eq. 7-13] pixel by pixel, `[T, 3, H, W]` -> `[T, 4, H, W]`."""
    grey = frames.mean(1)
    steps, height, width = grey.shape
    slow, delayed = grey[0].copy(), np.zeros((height, width))
    out = np.zeros((steps, 4, height, width))
    for t in range(steps):
        slow = slow + dt / (tau_high + dt) * (grey[t] - slow)
        high = grey[t] - slow
        delayed = delayed + dt / (tau_low + dt) * (high - delayed)
        for y in range(height):
            for x in range(width):
                for dy, dx, minus, plus in ((0, 1, LEFT, RIGHT), (1, 0, UP, DOWN)):
                    v, u = y + dy, x + dx
                    if border != "wrap" and (v == height or u == width):
                        continue
                    v, u = v % height, u % width
                    signed = high[v, u] * delayed[y, x] - high[y, x] * delayed[v, u]
                    out[t, plus if signed > 0 else minus, y, x] = abs(signed)
    return out


def drifting(dy: int, dx: int, size: tuple[int, int] = (24, 30), steps: int = 40) -> torch.Tensor:
    """A smooth random pattern on a torus that shifts by whole pixels a frame, `[T, 1, H, W]`."""
    pattern = np.fft.fft2(np.random.default_rng(1).random(size))
    low = np.hypot(*np.meshgrid(np.fft.fftfreq(size[0]), np.fft.fftfreq(size[1]), indexing="ij")) < 0.15
    image = np.fft.ifft2(pattern * low).real
    return torch.from_numpy(np.stack([np.roll(image, (t * dy, t * dx), (0, 1)) for t in range(steps)]))[:, None]


@pytest.mark.parametrize("border", BORDERS)
def test_images_are_those_of_a_loop_over_pixels(border: Border) -> None:
    frames = noise(5, 3, 5, 6)
    out, _ = HassensteinReichardt(0.02, 0.3, 0.04, border)(frames)
    assert_allclose(out, reference(frames.numpy(), 0.02, 0.3, 0.04, border), atol=1e-14)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (2, 2), (6, 5)])
def test_sums_are_the_sums_of_the_images(border: Border, size: tuple[int, int]) -> None:
    module = HassensteinReichardt(border=border)
    high, delayed, _ = module.scan(noise(6, *size), None)
    assert_allclose(module.sums(high, delayed), module.images(high, delayed).sum((-1, -2)), atol=1e-12)


@pytest.mark.parametrize(
    ("shift", "driven", "opposite"),
    [((0, -1), LEFT, RIGHT), ((0, 1), RIGHT, LEFT), ((1, 0), DOWN, UP), ((-1, 0), UP, DOWN)],
)
@pytest.mark.parametrize("border", BORDERS)
def test_a_moving_pattern_drives_its_own_direction(
    border: Border, shift: tuple[int, int], driven: int, opposite: int
) -> None:
    out, _ = HassensteinReichardt(border=border)(drifting(*shift))
    sums = out[-1].sum((-1, -2))
    assert sums.argmax() == driven
    assert sums[driven] > 2 * sums[opposite]


def test_transposing_swaps_right_with_down_and_left_with_up() -> None:
    module, frames = HassensteinReichardt(), noise(6, 1, 7, 8)
    assert_allclose(module(frames.mT)[0], module(frames)[0][:, [UP, DOWN, RIGHT, LEFT]].mT, atol=1e-15)


@pytest.mark.parametrize("border", BORDERS)
def test_a_static_scene_moves_nothing(border: Border) -> None:
    out, _ = HassensteinReichardt(border=border)(noise(3, 9, 9).float().expand(20, 3, 9, 9))
    assert not out.any()


@pytest.mark.parametrize("border", BORDERS)
def test_gradients_of_images_and_sums(border: Border) -> None:
    module, frames = HassensteinReichardt(0.05, border=border), noise(3, 1, 4, 3).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: module(v)[0], (frames,))

    def sums(image: torch.Tensor) -> torch.Tensor:
        high, delayed, _ = module.scan(image, None)
        return module.sums(high, delayed)

    assert torch.autograd.gradcheck(sums, (frames[:, 0],))
