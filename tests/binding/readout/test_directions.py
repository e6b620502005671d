"""How many directions are sources."""

from __future__ import annotations

import pytest
import torch

from ndtorch.binding.readout.sums import SumStatistics
from tests.binding.readout.three_lights import MIXING, count, lights


@pytest.mark.parametrize("white", [False, True])
def test_noise_of_a_third_on_every_sum_is_no_object(white: bool) -> None:
    generator = torch.Generator().manual_seed(2)
    noise = torch.randn(1500, 10, generator=generator)
    if not white:
        kernel = torch.exp(-0.5 * (torch.arange(-40, 41) / 12).square())
        noise = torch.nn.functional.conv1d(noise.mT[:, None], kernel[None, None], padding=40)[:, 0].mT
    sums = lights(15)[:, :2] @ MIXING[:2]
    assert count(SumStatistics()(100 * (sums + 0.3 * 0.35 * noise / noise.std()))) == 2


def test_bars_alike_in_color_and_orientation_are_told_apart_by_motion() -> None:
    mixing = MIXING.clone()
    mixing[2] = mixing[1]
    mixing[2, :4] = torch.tensor([0.0, 0.0, 1.0, 0.0])
    assert count(SumStatistics()(100 * lights(15) @ mixing)) == 3


def test_motion_of_a_time_course_of_its_own_is_no_second_thing() -> None:
    # Edges between pixels, and brightness that was another a moment ago, change how much moves, not where to.
    light = lights(15)[:, :1]
    sums = light @ MIXING[:1]
    t = torch.arange(len(light)) / 100
    sums[:, :4] *= 1 + 0.3 * (13 * t).sin()[:, None]
    assert count(SumStatistics()(100 * sums)) == 1
