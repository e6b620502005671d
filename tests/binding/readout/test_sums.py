"""Telling sources apart in the sums as they are."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from ndtorch.binding.covariance import CovarianceState
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.sums import sum_statistics, sums_table

MIXING = torch.zeros(3, 10)
MIXING[0, [1, 4, 5, 7]] = torch.tensor([1.0, 0.9, 0.3, 1.0])
MIXING[1, [0, 5, 6, 8]] = torch.tensor([1.0, 0.8, 0.2, 1.0])
MIXING[2, [3, 6, 4, 9]] = torch.tensor([1.0, 0.9, 0.1, 1.0])


def lights(seconds: float) -> Tensor:
    """Brightness of three things, `[T, 3]`."""
    t = torch.arange(round(seconds * 100)) / 100
    return 1 + 0.5 * torch.stack([(5 * t).sin(), (9 * t + 1).sin(), (3.3 * t).sin().sign()], -1)


def count(statistics: CovarianceState) -> int:
    """How many objects there are, with no word from the network."""
    none = ObjectTable(torch.zeros(10, dtype=torch.bool), torch.zeros(10, 10))
    return int(sums_table(none, torch.zeros(10, 10), statistics, torch.zeros(10, 10)).owners.sum())


@pytest.mark.parametrize("faint", [1.0, 0.25, 0.1])
def test_a_faint_thing_is_an_object(faint: float) -> None:
    weight = torch.tensor([1.0, 1.0, faint])
    assert count(sum_statistics()(100 * (lights(8) * weight) @ MIXING)) == 3


@pytest.mark.parametrize("white", [False, True])
def test_noise_of_a_third_on_every_sum_is_no_object(white: bool) -> None:
    generator = torch.Generator().manual_seed(2)
    noise = torch.randn(1500, 10, generator=generator)
    if not white:
        kernel = torch.exp(-0.5 * (torch.arange(-40, 41) / 12).square())
        noise = torch.nn.functional.conv1d(noise.mT[:, None], kernel[None, None], padding=40)[:, 0].mT
    sums = lights(15)[:, :2] @ MIXING[:2]
    assert count(sum_statistics()(100 * (sums + 0.3 * 0.35 * noise / noise.std()))) == 2


def test_what_has_left_is_no_object_soon_after() -> None:
    light = lights(20)
    light[1200:, 1] = 0.0
    sums = 100 * light @ MIXING
    assert count(sum_statistics()(sums[:1200])) == 3
    assert count(sum_statistics()(sums)) == 2


def test_nothing_that_fluctuates_is_nothing() -> None:
    assert count(sum_statistics()(torch.full((300, 10), 5.0))) == 0
