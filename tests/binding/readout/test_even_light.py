"""Light that changes everywhere."""

from __future__ import annotations

import pytest
import torch

from ndtorch.binding.readout.joint_diagonalisation import even_light
from ndtorch.binding.readout.owners import SumCriteria
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


@pytest.mark.parametrize("level", [0.01, 1.0, 100.0])
@pytest.mark.parametrize("others", [[], [BAR]])
def test_even_light_is_found_among_other_sources_at_any_level(level: float, others: list[list[float]]) -> None:
    """It changes colors more than orientations, all of them alike."""
    delayed = covariances((level, STANDS), *((0.7 * level, other) for other in others))
    light = even_light(delayed, torch.tensor([1 + len(others)]), SumCriteria())[0]
    wanted = torch.tensor(STANDS[4:], dtype=torch.float64)
    torch.testing.assert_close(light.abs(), wanted / wanted.norm(), rtol=0, atol=1e-6)


@pytest.mark.parametrize("level", [0.01, 1.0, 100.0])
def test_what_is_even_but_moves_is_no_light(level: float) -> None:
    delayed = covariances((level, MOVES), (0.7 * level, BAR))
    assert not even_light(delayed, torch.tensor([2]), SumCriteria()).any()


def test_one_color_and_one_orientation_are_no_light() -> None:
    assert not even_light(covariances((1.0, BAR)), torch.tensor([1]), SumCriteria()).any()
