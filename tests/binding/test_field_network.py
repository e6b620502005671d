"""One scale-free network shared by all fields."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from ndtorch.binding.field_network import FieldBinding
from ndtorch.binding.spectrum import spectral_radius
from ndtorch.errors import InputError
from tests.strategies import chunkings

UP, DOWN, RED, BLUE = 3, 2, 7, 9


def two_things(steps: int = 80) -> Tensor:
    """A red one that moves up through fields 0-3 and a blue one that moves down through fields 8-5, `[T, 12, 10]`."""
    signals = torch.zeros(steps, 12, 10)
    for n in range(10, steps):
        for start, way, features in ((0, 1, (UP, RED)), (8, -1, (DOWN, BLUE))):
            place = start + way * 3 * (n - 10) / (steps - 10)
            for f in range(12):
                weight = max(0.0, 1 - abs(f - place))
                signals[n, f, features[0]] = 0.3 * weight
                signals[n, f, features[1]] = 0.4 * weight
    return signals


@settings(max_examples=5, deadline=None)
@given(lengths=chunkings(30))
def test_chunks_give_the_same_as_the_whole(lengths: list[int]) -> None:
    signals = two_things(30)
    module = FieldBinding(0.04)
    (_, whole), end = module(signals)
    outs, state, at = [], None, 0
    for n in lengths:
        (_, out), state = module(signals[at : at + n], state)
        outs.append(out)
        at += n
    assert state is not None
    assert torch.equal(torch.cat(outs), whole)
    assert torch.equal(state.weights, end.weights)


def test_features_of_the_same_place_are_bound_and_others_are_not() -> None:
    _, state = FieldBinding(0.04)(two_things())
    bound = torch.maximum(state.weights, state.weights.mT)
    assert bound[UP, RED] > 0.3
    assert bound[DOWN, BLUE] > 0.3
    for one, other in ((UP, BLUE), (DOWN, RED), (UP, DOWN), (RED, BLUE)):
        assert bound[one, other] < 0.1


def test_without_learning_outputs_are_inputs() -> None:
    (inputs, outputs), state = FieldBinding(0.04, learn=False)(two_things(30))
    assert torch.equal(inputs, outputs)
    assert (state.weights == 0).all()


def test_nothing_happens_in_quiet_times() -> None:
    module = FieldBinding(0.04)
    _, taught = module(two_things())
    _, later = module(torch.zeros(500, 12, 10), taught)
    # Two seconds of after-effects of the filters, then the clock stands still.
    assert float(later.learned - taught.learned) < 12
    _, much_later = module(torch.zeros(500, 12, 10), later)
    assert torch.equal(much_later.weights, later.weights)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.floats(0.001, 100.0))
def test_weights_stay_bounded_for_any_input(seed: int, size: float) -> None:
    signals = size * torch.rand(40, 6, 10, generator=torch.Generator().manual_seed(seed)) ** 4
    _, state = FieldBinding(0.08)(signals)
    assert state.weights.min() >= -0.4 - 1e-6
    assert state.weights.max() <= 1.2 + 1e-6
    assert float(spectral_radius(state.weights.abs())) <= 0.951
    assert (state.weights.diagonal() == 0).all()


def test_unusable_signals_are_refused() -> None:
    with pytest.raises(InputError, match="signals"):
        FieldBinding(0.04)(torch.zeros(5, 3, 4))
    with pytest.raises(InputError, match="at least one"):
        FieldBinding(0.04)(torch.zeros(0, 3, 10))
