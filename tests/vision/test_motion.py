"""Directed and non-directional motion."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.vision import HassensteinReichardt
from ndtorch.vision.chahl_srinivasan import ChahlSrinivasan, row_shift
from ndtorch.vision.motion import BORDERS, Border
from ndtorch.vision.nondirectional import NDS, NDMin, NDMinus, spatial_maximum
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


@pytest.mark.parametrize("border", BORDERS)
def test_gradients_of_images_and_sums(border: Border) -> None:
    module, frames = HassensteinReichardt(0.05, border=border), noise(3, 1, 4, 3).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: module(v)[0], (frames,))

    def sums(image: torch.Tensor) -> torch.Tensor:
        high, delayed, _ = module.scan(image, None)
        return module.sums(high, delayed)

    assert torch.autograd.gradcheck(sums, (frames[:, 0],))


def by_hand(x, high=0.005, dt=1 / 30):
    """The high-pass as a scalar recursion in Python, pixel by pixel."""
    share, out = dt / (high + dt), []
    low = list(x[0])
    for sample in x:
        low = [old + share * (new - old) for new, old in zip(sample, low, strict=True)]
        out.append([new - old for new, old in zip(sample, low, strict=True)])
    return out


def test_values():
    x = noise(6, 1, 1, 8)
    high = by_hand(x[:, 0, 0].tolist())
    nd_min, nd_minus, nds = (s(x)[0][:, 0, 0].tolist() for s in (NDMin(), NDMinus(), NDS()))
    for t in range(6):
        for n in range(8):
            before, here, after = (high[t][min(max(k, 0), 7)] for k in (n - 1, n, n + 1))
            assert nd_min[t][n] == pytest.approx(here, abs=1e-12)
            assert nd_minus[t][n] == pytest.approx(here - (before + after) / 2, abs=1e-12)
            if 0 < n < 7:
                assert nds[t][n] == pytest.approx(before + here + after, abs=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0, 1))
def test_static_scene_is_zero(seed, tau):
    x = noise(1, 1, 3, 8, seed=seed).expand(5, 1, 3, 8)
    for sensor in (NDMin(tau), NDMinus(tau), NDS(tau, tau)):
        assert sensor(x)[0].abs().max() == 0


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_nd_minus_ignores_uniform_flicker(seed):
    x = noise(6, 1, 1, 1, seed=seed).expand(6, 1, 3, 8)
    assert NDMinus()(x)[0].abs().max() == 0
    assert NDMin()(x)[0].abs().max() > 0


def test_spatial_maximum():
    x = torch.zeros(2, 3, 2, 4, 5)
    x[1, 2, 1, 3, 0], x[1, 2, 0, 1, 1] = -3.0, 2.0
    out = spatial_maximum(x)
    assert out.shape == (2, 3, 2)
    assert out[1, 2].tolist() == [2.0, 3.0]
    assert out.sum() == 5


@pytest.mark.parametrize("shift", [-1.0, -0.3, 0.0, 0.7, 1.0])
def test_shift_of_a_ramp_is_exact(shift):
    place = torch.arange(20, dtype=torch.float64)
    ramp = (0.03 * place).reshape(1, 1, 20)
    moved = (0.03 * (place - shift)).reshape(1, 1, 20)
    assert float(row_shift(ramp, moved)) == pytest.approx(shift, abs=1e-9)


def test_shift_without_contrast_is_zero_and_has_a_gradient():
    x = torch.full((4, 1, 1, 8), 0.5, requires_grad=True)
    out, _ = ChahlSrinivasan()(x * torch.tensor([1.0, 0.9, 0.8, 0.7])[:, None, None, None])
    assert out.abs().max() == 0
    out.sum().backward()
    assert torch.isfinite(x.grad).all()
