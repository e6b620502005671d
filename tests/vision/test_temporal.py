"""First-order filters against scipy.signal, the recent maximum against a loop."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from ndtorch.vision import HighPass, LowPass, RunningMax
from tests.strategies import chunkings, in_chunks


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def low_passed(x: np.ndarray, tau: float, dt: float) -> np.ndarray:
    """The same filter as a difference equation along the first axis, settled on the first sample."""
    a = dt / (tau + dt)
    return lfilter([a], [1, a - 1], x, axis=0, zi=(1 - a) * x[:1])[0]


@pytest.mark.parametrize("tau", [0.004, 0.5, 3.0])
def test_low_pass_is_a_first_order_recursion(tau: float) -> None:
    x = noise(40, 10)
    out, state = LowPass(tau, 0.01, sample_dims=1)(x)
    expected = low_passed(x.numpy(), tau, 0.01)
    assert_allclose(out, expected, atol=1e-13)
    assert_allclose(state.low, expected[-1], atol=1e-13)


@pytest.mark.parametrize("tau", [0.004, 0.5, 3.0])
def test_high_pass_is_what_the_low_pass_leaves(tau: float) -> None:
    x = noise(40, 10)
    out, _ = HighPass(tau, 0.01, sample_dims=1)(x)
    assert_allclose(out, x.numpy() - low_passed(x.numpy(), tau, 0.01), atol=1e-13)


def test_tau_zero_passes_and_tau_inf_holds_the_first_sample() -> None:
    x = noise(7, 4)
    assert torch.equal(LowPass(0.0, 0.01, 1)(x)[0], x)
    assert torch.equal(LowPass(math.inf, 0.01, 1)(x)[0], x[:1].expand(7, 4))
    assert torch.equal(HighPass(0.0, 0.01, 1)(x)[0], torch.zeros(7, 4, dtype=x.dtype))
    assert torch.equal(HighPass(math.inf, 0.01, 1)(x)[0], x - x[:1])


@pytest.mark.parametrize("kind", [LowPass, HighPass])
@pytest.mark.parametrize("tau", [0.0, 0.1, math.inf])
@settings(max_examples=15, deadline=None)
@given(lengths=chunkings(20))
def test_chunks_give_the_whole(kind: type[torch.nn.Module], tau: float, lengths: list[int]) -> None:
    x, module = noise(2, 20, 3), kind(tau, 0.01, 1)
    whole, end = module(x)
    parts, part_end = in_chunks(module, x, lengths, -2)
    assert torch.equal(parts, whole)
    assert torch.equal(part_end.low, end.low)


@pytest.mark.parametrize("kind", [LowPass, HighPass])
def test_gradients(kind: type[torch.nn.Module]) -> None:
    x = noise(5, 3).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: kind(0.1, 0.05, 1)(v)[0], (x,))


def recent_max(x: np.ndarray, window: int) -> np.ndarray:
    return np.stack([x[max(0, t - window + 1) : t + 1].max(0) for t in range(len(x))])


@pytest.mark.parametrize(("seconds", "window"), [(0.0, 1), (0.01, 1), (0.05, 5), (2.0, 200)])
def test_recent_max_looks_back_over_its_window(seconds: float, window: int) -> None:
    x = noise(60, 3)
    out, state = RunningMax(seconds, 0.01)(x)
    assert_allclose(out, recent_max(x.numpy(), window))
    assert state.history.shape == (window - 1, 3)


@settings(max_examples=25, deadline=None)
@given(seconds=st.sampled_from([0.0, 0.02, 0.07, 0.5]), lengths=chunkings(24))
def test_recent_max_in_chunks(seconds: float, lengths: list[int]) -> None:
    x, module = noise(2, 24, 3), RunningMax(seconds, 0.01)
    whole, end = module(x)
    parts, part_end = in_chunks(module, x, lengths, -2)
    assert torch.equal(parts, whole)
    assert torch.equal(part_end.history, end.history)
