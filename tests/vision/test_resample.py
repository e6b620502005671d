"""Interpolation from the rate of the frames to that of the networks."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.errors import InputError
from ndtorch.vision import Resample, ResampleState
from tests.strategies import chunkings, in_chunks

RATES = st.one_of(st.floats(5, 240), st.sampled_from([12.5, 24, 25, 30, 29.97, 50, 60, 100, 120, 240]))


def noise(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


@settings(max_examples=60, deadline=None)
@given(fps=RATES, data=st.data())
def test_any_chunks_at_any_rate_interpolate(fps: float, data: st.DataObject) -> None:
    lengths = data.draw(chunkings(40))
    x = noise(40, 2)
    out, state = in_chunks(Resample(1 / fps, 0.01), x, lengths, -2)
    count = math.floor(39 / fps / 0.01 + 1e-6) + 1
    assert out.shape == (count, 2)
    assert (int(state.taken), int(state.given)) == (40, count if fps != 100 else 40)
    times, frames = np.arange(count) * 0.01, np.arange(40) / fps
    for column, expected in zip(out.T, x.T, strict=True):
        assert_allclose(column, np.interp(times, frames, expected), atol=1e-9)


@pytest.mark.parametrize(("fps", "count"), [(12.5, 73), (25, 37), (30, 31), (50, 19), (100, 10), (120, 8), (200, 5)])
def test_counts(fps: float, count: int) -> None:
    assert Resample(1 / fps, 0.01)(torch.zeros(10, 3))[0].shape == (count, 3)


@pytest.mark.parametrize("fps", [12.5, 25, 29.97, 30, 60, 120, 240])
def test_counts_and_places_stay_exact_after_an_hour(fps: float) -> None:
    taken = round(3600 * fps) + 1
    given = math.floor((taken - 1) / fps * 100 + 1e-6) + 1
    ramp = (taken + torch.arange(50, dtype=torch.float64)) / fps
    last = torch.tensor([(taken - 1) / fps], dtype=torch.float64)
    state = ResampleState(last, torch.tensor(taken), torch.tensor(given))
    out, end = Resample(1 / fps, 0.01)(ramp[:, None], state)
    expected = np.arange(given, math.floor((taken + 49) / fps * 100 + 1e-6) + 1) * 0.01
    assert int(end.given) == given + len(out)
    assert_allclose(out[:, 0], expected, atol=1e-8)


@pytest.mark.parametrize("fps", [30, 240])
def test_a_ramp_frame_by_frame_keeps_its_count_for_minutes(fps: float) -> None:
    module, state, count = Resample(1 / fps, 0.01), None, 0
    for chunk in torch.zeros(round(60 * fps) + 1, 1).split(7):
        out, state = module(chunk, state)
        count += len(out)
    assert count == 6001


def test_equal_steps_pass_the_input_through() -> None:
    x = noise(5, 3)
    out, state = Resample(0.01, 0.01 * (1 + 1e-12))(x)
    assert out is x
    assert torch.equal(state.last, x[-1])
    assert (int(state.taken), int(state.given)) == (5, 5)


def test_a_chunk_may_give_nothing() -> None:
    module = Resample(1 / 240, 0.01)
    first, state = module(noise(1, 3))
    second, state = module(noise(1, 3), state)
    assert (len(first), len(second)) == (1, 0)
    assert second.shape == (0, 3)
    assert int(state.taken) == 2


@pytest.mark.parametrize("fps", [30, 240])
def test_batch_equals_single_runs(fps: float) -> None:
    x, module = noise(2, 3, 9, 4), Resample(1 / fps, 0.01)
    out, state = in_chunks(module, x, 2, -2)
    assert state.last.shape == (2, 3, 4)
    assert_allclose(out[1, 2], in_chunks(module, x[1, 2], 2, -2)[0], atol=1e-15)


def test_float32_is_near_float64() -> None:
    x, module = noise(100, 4), Resample(1 / 30, 0.01)
    assert_allclose(module(x.float())[0], module(x)[0], atol=1e-5)


@pytest.mark.parametrize("fps", [30, 240])
def test_gradients(fps: float) -> None:
    module = Resample(1 / fps, 0.01)
    assert torch.autograd.gradcheck(lambda x: module(x)[0], (noise(6, 2).requires_grad_(),))


@pytest.mark.parametrize("value", [0.0, -0.1, math.inf, math.nan])
def test_steps_out_of_range_are_refused_by_name(value: float) -> None:
    with pytest.raises(InputError, match="dt_in must be a positive number"):
        Resample(value, 0.01)
    with pytest.raises(InputError, match="dt_out must be a positive number"):
        Resample(0.01, value)


@pytest.mark.parametrize("shape", [(0, 3), (3,)])
def test_inputs_without_time_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"^x must "):
        Resample(0.02, 0.01)(torch.zeros(shape))
