"""Filters over a stretch of signals at once."""

from __future__ import annotations

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.vision import LowPass
from ndtorch.vision.blocks import BlockLowPass, low_pass
from tests.strategies import chunkings


@settings(max_examples=20, deadline=None)
@given(a=st.floats(0.001, 1.0), lengths=chunkings(130))
def test_block_low_pass_is_the_loop(a: float, lengths: list[int]) -> None:
    signals = torch.randn(130, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    expected, low = [], signals[0]
    for sample in signals:
        low = low + a * (sample - low)
        expected.append(low)
    state, parts = signals[0], []
    for chunk in torch.split(signals, lengths):
        out, state = low_pass(BlockLowPass(a, 50), chunk, state)
        parts.append(out)
    assert_allclose(torch.cat(parts), torch.stack(expected), atol=1e-12)
    module, _ = LowPass(1 / a - 1, 1.0, 1)(signals)
    assert_allclose(torch.cat(parts), module, atol=1e-9)
