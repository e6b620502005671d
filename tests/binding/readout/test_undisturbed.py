"""A memory without the seconds in which bars come near each other."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from ndtorch.binding.readout.owners import SumCriteria
from ndtorch.binding.readout.source_count import undisturbed
from ndtorch.binding.readout.sums import SumStatistics
from tests.binding.readout.three_lights import MIXING, count, lights


def passing(seconds: float, begin: float, end: float, bars: int) -> Tensor:
    """Sums of bars, two of which pass each other: the size of a sum of filters is less than the sum of sizes."""
    light = lights(seconds)
    sums = light[:, :bars] @ MIXING[:bars]
    t = torch.arange(len(light)) / 100
    near = torch.where((t > begin) & (t < end), ((t - begin) * torch.pi / (end - begin)).sin(), 0.0)
    lost = 0.15 * near * (light[:, 0] * light[:, 1]).sqrt()
    sums[:, 4:7] -= lost[:, None] * torch.tensor([0.7, 0.2, 1.0])
    return 100 * sums


@pytest.mark.parametrize("bars", [2, 3])
def test_bars_that_pass_each_other_are_no_further_thing(bars: int) -> None:
    assert count(SumStatistics()(passing(14, 11.8, 13.8, bars))) == bars


@pytest.mark.parametrize("bars", [2, 3])
def test_bars_that_pass_each_other_again_and_again_are_no_further_thing(bars: int) -> None:
    light = lights(24)
    sums = light[:, :bars] @ MIXING[:bars]
    since = torch.arange(len(light)) / 100 % 6.0
    near = torch.where(since < 2, (since * torch.pi / 2).sin(), 0.0)  # two seconds of six, as in the papers' scene
    # How far the filters reach over both changes with the distance, in every orientation another way.
    shape = torch.stack([near, near**2, near**4], -1) @ torch.tensor(
        [[0.7, 0.2, 1.0], [0.1, 0.8, -0.3], [-0.4, 0.3, 0.5]]
    )
    sums[:, 4:7] -= 0.15 * shape * (light[:, 0] * light[:, 1]).sqrt()[:, None]
    assert count(SumStatistics()(100 * sums)) == bars


def test_the_seconds_of_passing_are_left_out_and_the_rest_is_as_strong_as_before() -> None:
    limits = SumCriteria()
    with_it, without = (SumStatistics()(passing(14, begin, begin + 2.0, 2)).all for begin in (5.0, 20.0))
    one, other = (undisturbed(kept, 12.0, 1.0, limits)[1] for kept in (with_it, without))
    assert torch.linalg.eigvalsh(one)[-3] < 1e-4 * torch.linalg.eigvalsh(one)[-1]
    all_of_it = undisturbed(with_it, 12.0, 1.0, SumCriteria(covered=1e9))[1]
    assert torch.linalg.eigvalsh(all_of_it)[-3] > 1e-3 * torch.linalg.eigvalsh(all_of_it)[-1]
    assert one.trace() == pytest.approx(float(other.trace()), rel=0.2)
