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

from ndtorch.errors import InputError
from ndtorch.vision import HighPass, LowPass, RunningMax, low_pass_step, smoothing_factor
from tests.strategies import chunkings, in_chunks


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def low_passed(x: np.ndarray, tau: float, dt: float) -> np.ndarray:
    """The same filter as a difference equation along the first axis, settled on the first sample."""
    a = dt / (tau + dt)
    return lfilter([a], [1, a - 1], x, axis=0, zi=(1 - a) * x[:1])[0]


@pytest.mark.parametrize(("tau", "dt", "a"), [(0.09, 0.01, 0.1), (0.0, 0.3, 1.0), (math.inf, 0.01, 0.0)])
def test_smoothing_factor(tau: float, dt: float, a: float) -> None:
    assert smoothing_factor(tau, dt) == pytest.approx(a, abs=1e-15)


@pytest.mark.parametrize("tau", [-1e-9, -math.inf, math.nan])
def test_tau_out_of_range_is_refused(tau: float) -> None:
    with pytest.raises(InputError, match=r"tau must be >= 0"):
        smoothing_factor(tau, 0.01)


@pytest.mark.parametrize("dt", [0.0, -0.01, math.inf, math.nan])
def test_dt_out_of_range_is_refused(dt: float) -> None:
    with pytest.raises(InputError, match=r"dt must be a positive number"):
        smoothing_factor(0.5, dt)


@pytest.mark.parametrize("kind", [LowPass, HighPass])
def test_filters_refuse_bad_time_constants(kind: type[torch.nn.Module]) -> None:
    with pytest.raises(InputError, match="tau"):
        kind(-1.0, 0.01)
    with pytest.raises(InputError, match="dt"):
        kind(1.0, 0.0)


def test_low_pass_step_takes_in_the_share_a() -> None:
    x, low = torch.tensor([[1.0, 3.0]]), torch.tensor([[0.0], [1.0]])
    assert_allclose(low_pass_step(x, low, 0.25), [[0.25, 0.75], [1.0, 1.5]])


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


def test_step_response_is_backward_euler() -> None:
    x = torch.cat([torch.zeros(1, 1), torch.ones(5, 1)])
    out, _ = LowPass(0.03, 0.01, sample_dims=1)(x)
    assert_allclose(out[:, 0], 1 - 0.75 ** np.arange(6), atol=1e-7)


def test_tau_zero_passes_and_tau_inf_holds_the_first_sample() -> None:
    x = noise(7, 4)
    assert torch.equal(LowPass(0.0, 0.01, 1)(x)[0], x)
    assert torch.equal(LowPass(math.inf, 0.01, 1)(x)[0], x[:1].expand(7, 4))
    assert torch.equal(HighPass(0.0, 0.01, 1)(x)[0], torch.zeros(7, 4, dtype=x.dtype))
    assert torch.equal(HighPass(math.inf, 0.01, 1)(x)[0], x - x[:1])


@pytest.mark.parametrize("tau", [0.0, 0.05, math.inf])
def test_high_pass_of_a_constant_is_exactly_zero(tau: float) -> None:
    x = noise(3, 4, 5).float().expand(9, 3, 4, 5)
    out, _ = HighPass(tau, 0.01)(x)
    assert not out.any()


@pytest.mark.parametrize("kind", [LowPass, HighPass])
@pytest.mark.parametrize("batch", [(), (2,), (2, 3)])
def test_frames_keep_shape_and_state_is_one_sample(kind: type[torch.nn.Module], batch: tuple[int, ...]) -> None:
    x = noise(*batch, 6, 3, 4, 5)
    out, state = kind(0.1, 0.01)(x)
    assert out.shape == x.shape
    assert state.low.shape == (*batch, 3, 4, 5)


@pytest.mark.parametrize("kind", [LowPass, HighPass])
def test_batch_equals_single_runs(kind: type[torch.nn.Module]) -> None:
    x = noise(3, 12, 4)
    module = kind(0.1, 0.01, 1)
    assert torch.equal(module(x)[0], torch.stack([module(one)[0] for one in x]))


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
def test_float32_is_near_float64(kind: type[torch.nn.Module]) -> None:
    x, module = noise(500, 4), kind(0.5, 0.01, 1)
    assert_allclose(module(x.float())[0], module(x)[0], atol=1e-5)


@pytest.mark.parametrize("kind", [LowPass, HighPass])
def test_gradients(kind: type[torch.nn.Module]) -> None:
    x = noise(5, 3).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: kind(0.1, 0.05, 1)(v)[0], (x,))


@pytest.mark.parametrize("kind", [LowPass, HighPass])
def test_too_few_dimensions_are_refused(kind: type[torch.nn.Module]) -> None:
    with pytest.raises(InputError, match=r"\[\.\.\., T, C, H, W\], got \(3, 4, 5\)"):
        kind(0.1, 0.01)(torch.zeros(3, 4, 5))
    with pytest.raises(InputError, match=r"\[\.\.\., T, N\], got \(3,\)"):
        kind(0.1, 0.01, 1)(torch.zeros(3))


@pytest.mark.parametrize("module", [LowPass(0.1, 0.01, 1), HighPass(0.0, 0.01, 1), RunningMax(1.0, 0.1)])
def test_no_time_step_is_refused(module: torch.nn.Module) -> None:
    with pytest.raises(InputError, match="at least one time step"):
        module(torch.zeros(2, 0, 4))


def recent_max(x: np.ndarray, window: int) -> np.ndarray:
    return np.stack([x[max(0, t - window + 1) : t + 1].max(0) for t in range(len(x))])


@pytest.mark.parametrize(("seconds", "window"), [(0.0, 1), (0.01, 1), (0.05, 5), (2.0, 200)])
def test_recent_max_looks_back_over_its_window(seconds: float, window: int) -> None:
    x = noise(60, 3)
    out, state = RunningMax(seconds, 0.01)(x)
    assert_allclose(out, recent_max(x.numpy(), window))
    assert state.history.shape == (window - 1, 3)


def test_recent_max_forgets_after_its_window() -> None:
    x = torch.zeros(8, 1)
    x[1] = 5.0
    out, _ = RunningMax(0.3, 0.1)(x)
    assert out[:, 0].tolist() == [0, 5, 5, 5, 0, 0, 0, 0]


def test_recent_max_starts_as_if_the_first_sample_had_been_there_for_ever() -> None:
    out, state = RunningMax(0.3, 0.1)(torch.tensor([[-1.0], [-2.0], [-3.0]]))
    assert out[:, 0].tolist() == [-1, -1, -1]
    assert state.history[:, 0].tolist() == [-2, -3]


@settings(max_examples=25, deadline=None)
@given(seconds=st.sampled_from([0.0, 0.02, 0.07, 0.5]), lengths=chunkings(24))
def test_recent_max_in_chunks(seconds: float, lengths: list[int]) -> None:
    x, module = noise(2, 24, 3), RunningMax(seconds, 0.01)
    whole, end = module(x)
    parts, part_end = in_chunks(module, x, lengths, -2)
    assert torch.equal(parts, whole)
    assert torch.equal(part_end.history, end.history)


def test_recent_max_of_a_batch_is_each_trials_own() -> None:
    x, module = noise(2, 3, 15, 4), RunningMax(0.05, 0.01)
    assert torch.equal(module(x)[0][1, 2], module(x[1, 2])[0])


@pytest.mark.parametrize(("seconds", "dt"), [(-1.0, 0.1), (math.inf, 0.1), (math.nan, 0.1), (1.0, 0.0)])
def test_recent_max_refuses_bad_windows(seconds: float, dt: float) -> None:
    with pytest.raises(InputError, match=r"seconds must be >= 0 and dt > 0"):
        RunningMax(seconds, dt)
