"""How a network's weights change, and how much its outputs alternate."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from ndtorch.binding import InhibitoryNetwork, alternation, weight_change
from tests.binding.plain_network import noise, reference, small


def test_weight_change_sums_the_recent_changes_of_the_weights() -> None:
    inputs = noise(60, 3)
    _, state = small(tau_mean=0.0, window=0.2)(inputs)
    _, weights, _ = reference(inputs.numpy(), "competitive")
    assert float(weight_change(state)) == pytest.approx(abs(np.diff(weights, axis=0))[-20:].sum())


def test_alternation_of_signals_that_flip_and_of_slow_ones() -> None:
    signs = torch.tensor([1.0, -1.0]).repeat(200)[:, None].expand(400, 2).clone()
    signs[0] = 0
    slow = torch.sin(torch.arange(400) * 0.02)[:, None].expand(400, 2)
    silent = InhibitoryNetwork(2, rule=None, tau_in=math.inf)
    assert alternation(silent(signs)[1]) == pytest.approx(1, abs=1e-3)
    assert alternation(silent(slow)[1]) < 1e-3
    white = torch.cat([torch.zeros(1, 2, dtype=torch.float64), noise(4000, 2)])
    assert alternation(silent(white)[1]) == pytest.approx(0.5, abs=0.1)
