"""High-pass and group normalisation against a loop over time."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.binding import BindingInputs
from ndtorch.binding.normalise import ORDERS, InputState, Order, divide
from tests.strategies import chunkings

EDGES = [(0, 4), (4, 7), (7, 10)]


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def run(module: BindingInputs, x: torch.Tensor, lengths: list[int]) -> tuple[torch.Tensor, InputState]:
    parts, state = [], None
    for chunk in x.split(lengths, -2):
        (inputs, _), state = module(chunk, state)
        parts.append(inputs)
    assert state is not None
    return torch.cat(parts, -2), state


def reference(
    sums: np.ndarray, order: str, tau: float, dt: float, window: int, floor: float
) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and scale, `[T, 10]` each, one number after the other."""
    inputs, scale = np.zeros_like(sums), np.zeros_like(sums)
    fluctuations = np.zeros_like(sums)
    for a, b in EDGES:
        low = None
        for t in range(len(sums)):
            recent = slice(max(0, t - window + 1), t + 1)
            raw = max(sums[recent, a:b].max(), sums[0, a:b].max() if t < window else -np.inf)
            scale[t, a:b] = raw
            x = sums[t, a:b] / raw if order == "printed" else sums[t, a:b]
            low = x if low is None else low + dt / (tau + dt) * (x - low)
            fluctuations[t, a:b] = x - low
            if order == "printed":
                inputs[t, a:b] = fluctuations[t, a:b]
            else:
                divisor = max(abs(fluctuations[recent, a:b]).max(), floor * raw)
                inputs[t, a:b] = fluctuations[t, a:b] / divisor
    return inputs, scale


@pytest.mark.parametrize("order", ORDERS)
def test_inputs_and_scale_are_those_of_a_loop(order: Order) -> None:
    sums = 5 + noise(60, 10)
    (inputs, scale), _ = BindingInputs(0.02, order, tau=0.3, window=0.4, floor=0.02)(sums)
    expected = reference(sums.numpy(), order, 0.3, 0.02, 20, 0.02)
    assert_allclose(inputs, expected[0], atol=1e-12)
    assert_allclose(scale, expected[1])


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**31), scale=st.floats(1e-6, 1e6), floor=st.sampled_from([0.0, 0.01, 1.0]))
def test_filtered_inputs_never_exceed_one(seed: int, scale: float, floor: float) -> None:
    sums = (noise(50, 10, seed=seed).float() ** 4) * scale
    (inputs, _), _ = BindingInputs(0.05, window=0.3, floor=floor)(sums)
    assert inputs.abs().max() <= 1


def test_the_largest_fluctuation_of_a_group_becomes_one() -> None:
    sums = torch.full((2, 10), 10.0)
    sums[1] += torch.arange(10.0)
    (inputs, _), _ = BindingInputs()(sums)
    assert_allclose(inputs[1], [0, 1 / 3, 2 / 3, 1, 4 / 6, 5 / 6, 1, 7 / 9, 8 / 9, 1], atol=1e-5)


@pytest.mark.parametrize("order", ORDERS)
def test_a_static_scene_gives_exactly_zero(order: Order) -> None:
    (inputs, _), _ = BindingInputs(order=order)(noise(1, 10).float().expand(300, 10))
    assert not inputs.any()


@pytest.mark.parametrize("order", ORDERS)
def test_a_silent_group_stays_zero(order: Order) -> None:
    sums = noise(30, 10)
    sums[:, :4] = 0
    (inputs, scale), _ = BindingInputs(order=order)(sums)
    assert not inputs[:, :4].any()
    assert not scale[:, :4].any()
    assert torch.isfinite(inputs).all()


def test_fluctuations_below_the_floor_are_not_blown_up() -> None:
    sums = 100 + 1e-4 * noise(200, 10)
    (quiet, _), _ = BindingInputs(floor=0.01)(sums)
    (loud, _), _ = BindingInputs(floor=0.0)(sums)
    assert quiet.abs().max() < 1e-4
    assert loud.abs().max() == 1


@settings(max_examples=15, deadline=None)
@given(order=st.sampled_from(ORDERS), lengths=chunkings(25))
def test_chunks_give_the_whole(order: Order, lengths: list[int]) -> None:
    module, sums = BindingInputs(0.05, order, window=0.3), 1 + noise(2, 25, 10)
    (whole, _), end = module(sums)
    parts, part_end = run(module, sums, lengths)
    assert_allclose(parts, whole, atol=1e-12)
    for a, b in zip(part_end, end, strict=True):
        assert_allclose(a, b, atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_gradients(order: Order) -> None:
    module = BindingInputs(0.05, order, window=0.2)
    sums = (1 + noise(6, 10)).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: module(x)[0], (sums,))


def test_division_by_zero_is_zero_and_has_a_gradient() -> None:
    signals = torch.tensor([3.0, 4.0], requires_grad=True)
    out = divide(signals, torch.tensor([0.0, 2.0]))
    out.sum().backward()
    assert out.tolist() == [0, 2]
    assert signals.grad is not None
    assert signals.grad.tolist() == [0, 0.5]
