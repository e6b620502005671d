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


def covariances(*sources: tuple[float, list[float]]) -> torch.Tensor:
    """Of sources that do not know of each other, by their variance and their share of each signal, `[1, 10, 10]`."""
    total = torch.zeros(10, 10, dtype=torch.float64)
    for variance, share in sources:
        total += variance * torch.outer(*[torch.tensor(share, dtype=torch.float64)] * 2)
    return total[None]


STANDS = [0, 0, 0, 0, 0.2, 0.2, 0.2, 1, 1, 1]
MOVES = [0, 0.5, 0, 0, 0.2, 0.2, 0.2, 1, 1, 1]
BAR = [0, 1.0, 0, 0, 1, 0.3, 0, 1, 0, 0]
