"""Light that changes everywhere."""

from __future__ import annotations

import pytest
import torch

from ndtorch.binding.readout.sums import SumStatistics
from tests.binding.readout.three_lights import MIXING, count, lights


@pytest.mark.parametrize("bars", [0, 1, 2, 3])
def test_a_lamp_on_everything_is_no_object(bars: int) -> None:
    t = torch.arange(1500) / 100
    lamp = torch.zeros(10)
    lamp[4:] = 0.4
    sums = lights(15)[:, :bars] @ MIXING[:bars] + (2 + torch.sin(7 * t + torch.sin(t)))[:, None] * lamp
    assert count(SumStatistics()(100 * sums)) == bars
