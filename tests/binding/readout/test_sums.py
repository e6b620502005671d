"""Telling sources apart in the sums as they are."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.params import SourceCriteria, SumCriteria
from ndtorch.binding.readout.sums import SumState, SumStatistics, sources_of, sums_table
from ndtorch.errors import InputError

MIXING = torch.zeros(3, 10)
MIXING[0, [1, 4, 5, 7]] = torch.tensor([1.0, 0.9, 0.3, 1.0])
MIXING[1, [0, 5, 6, 8]] = torch.tensor([1.0, 0.8, 0.2, 1.0])
MIXING[2, [3, 6, 4, 9]] = torch.tensor([1.0, 0.9, 0.1, 1.0])


def lights(seconds: float) -> Tensor:
    """Brightness of three things, `[T, 3]`."""
    t = torch.arange(round(seconds * 100)) / 100
    return 1 + 0.5 * torch.stack([(5 * t).sin(), (9 * t + 1).sin(), (3.3 * t).sin().sign()], -1)


def count(statistics: SumState) -> int:
    """How many objects there are, with no word from the network."""
    none = ObjectTable(torch.zeros(10, dtype=torch.bool), torch.zeros(10, 10))
    return int(sums_table(none, torch.zeros(10, 10), statistics, torch.zeros(10, 10)).owners.sum())


@pytest.mark.parametrize("faint", [1.0, 0.25, 0.1])
def test_a_faint_thing_is_an_object(faint: float) -> None:
    weight = torch.tensor([1.0, 1.0, faint])
    assert count(SumStatistics()(100 * (lights(8) * weight) @ MIXING)) == 3


@pytest.mark.parametrize("white", [False, True])
def test_noise_of_a_third_on_every_sum_is_no_object(white: bool) -> None:
    generator = torch.Generator().manual_seed(2)
    noise = torch.randn(1500, 10, generator=generator)
    if not white:
        kernel = torch.exp(-0.5 * (torch.arange(-40, 41) / 12).square())
        noise = torch.nn.functional.conv1d(noise.mT[:, None], kernel[None, None], padding=40)[:, 0].mT
    sums = lights(15)[:, :2] @ MIXING[:2]
    assert count(SumStatistics()(100 * (sums + 0.3 * 0.35 * noise / noise.std()))) == 2


def test_what_has_left_is_no_object_soon_after() -> None:
    light = lights(20)
    light[1200:, 1] = 0.0
    sums = 100 * light @ MIXING
    assert count(SumStatistics()(sums[:1200])) == 3
    assert count(SumStatistics()(sums)) == 2


def test_nothing_that_fluctuates_is_nothing() -> None:
    assert count(SumStatistics()(torch.full((300, 10), 5.0))) == 0


def separated(sums: Tensor) -> tuple[int, Tensor, float]:
    """Number, mixing and gap of the sources in the long memory."""
    kept = SumStatistics()(sums).all.covariances[2]
    found = sources_of((kept / kept[0].diagonal().amax()).double(), SourceCriteria(), SumCriteria())
    return int(found.number), found.mixing, float(found.gap)


def test_the_mixing_of_known_sources_is_found() -> None:
    number, mixing, _ = separated(lights(40) @ MIXING)
    assert number == 3
    unit = torch.nn.functional.normalize
    likeness = unit(mixing[:3].float(), dim=-1) @ unit(MIXING, dim=-1).T
    assert likeness.amax(-1).min() > 0.99
    assert sorted(likeness.argmax(-1).tolist()) == [0, 1, 2]


def test_equal_rates_are_said_to_be_indistinct() -> None:
    t = torch.arange(3000) / 100
    equal = torch.stack([torch.sin(5 * t), torch.sin(5 * t + 1.5)], -1)
    other = torch.stack([torch.sin(5.5 * t), torch.sin(8.2 * t + 1.5)], -1)
    assert separated(equal @ MIXING[:2])[2] < 0.02 < separated(other @ MIXING[:2])[2]


@pytest.mark.parametrize("bars", [0, 1, 2, 3])
def test_a_lamp_on_everything_is_no_object(bars: int) -> None:
    t = torch.arange(1500) / 100
    lamp = torch.zeros(10)
    lamp[4:] = 0.4
    sums = lights(15)[:, :bars] @ MIXING[:bars] + (2 + torch.sin(7 * t + torch.sin(t)))[:, None] * lamp
    assert count(SumStatistics()(100 * sums)) == bars


def test_bars_alike_in_color_and_orientation_are_told_apart_by_motion() -> None:
    mixing = MIXING.clone()
    mixing[2] = mixing[1]
    mixing[2, :4] = torch.tensor([0.0, 0.0, 1.0, 0.0])
    assert count(SumStatistics()(100 * lights(15) @ mixing)) == 3


def test_a_change_of_all_objects_is_a_new_scene() -> None:
    light, other = lights(24), torch.zeros(3, 10)
    other[0, [2, 5, 6, 7, 9]] = torch.tensor([1.0, 0.9, 0.7, 0.8, 1.0])
    change = (torch.arange(len(light)) >= 1600)[:, None]
    sums = torch.where(change, light[:, :1] @ other[:1], light[:, :2] @ MIXING[:2])
    state = SumStatistics()(100 * sums)
    assert 5 < float(state.scene.age) < 8
    assert count(state) == 1
    # What stays as it is begins nothing anew.
    assert float(SumStatistics()(100 * light[:, :2] @ MIXING[:2]).scene.age) > 23


def test_delays_of_nothing_are_refused() -> None:
    with pytest.raises(InputError, match="delays must be positive"):
        SumStatistics(delays=(0.0,))
