"""Interpolation from the rate of the frames to that of the networks."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.vision import Resample, ResampleState
from tests.strategies import chunkings, in_chunks, noise

RATES = st.one_of(st.floats(5, 240), st.sampled_from([12.5, 24, 25, 30, 29.97, 50, 60, 100, 120, 240]))


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
def test_gradients(fps: float) -> None:
    module = Resample(1 / fps, 0.01)
    assert torch.autograd.gradcheck(lambda x: module(x)[0], (noise(6, 2).requires_grad_(),))
