"""Non-directional sensors and the row shift: values, state, borders and bad input."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.autograd import gradcheck

from ndtorch.vision.chahl_srinivasan import ChahlSrinivasan, row_shift
from ndtorch.vision.nondirectional import NDS, NDMin, NDMinus, spatial_maximum

SENSORS = [NDMin(), NDMinus(), NDS(), NDS(tau_low=0.02), ChahlSrinivasan()]


def video(*shape, dtype=torch.float32, seed=0):
    return torch.rand(*shape, dtype=dtype, generator=torch.Generator().manual_seed(seed))


def by_hand(x, high=0.005, dt=1 / 30):
    """The high-pass as a scalar recursion in Python, pixel by pixel."""
    share, out = dt / (high + dt), []
    low = list(x[0])
    for sample in x:
        low = [old + share * (new - old) for new, old in zip(sample, low, strict=True)]
        out.append([new - old for new, old in zip(sample, low, strict=True)])
    return out


def test_values():
    x = video(6, 1, 1, 8, dtype=torch.float64)
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
    x = video(1, 1, 3, 8, seed=seed).expand(5, 1, 3, 8)
    for sensor in (NDMin(tau), NDMinus(tau), NDS(tau, tau)):
        assert sensor(x)[0].abs().max() == 0


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_nd_minus_ignores_uniform_flicker(seed):
    x = video(6, 1, 1, 1, seed=seed).expand(6, 1, 3, 8)
    assert NDMinus()(x)[0].abs().max() == 0
    assert NDMin()(x)[0].abs().max() > 0


@pytest.mark.parametrize("sensor", SENSORS, ids=lambda s: type(s).__name__)
def test_gradients_and_precision(sensor):
    x = video(3, 1, 1, 6, dtype=torch.float64)
    assert gradcheck(lambda y: sensor(y)[0], (x.requires_grad_(),))
    torch.testing.assert_close(sensor(x.float())[0].double(), sensor(x)[0], atol=1e-5, rtol=1e-4)


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
