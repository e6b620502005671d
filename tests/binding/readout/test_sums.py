"""How many sources the sums hold: faint, noisy, alike, passing each other, coming and going."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.owners import SumCriteria
from ndtorch.binding.readout.source_count import beside, undisturbed
from ndtorch.binding.readout.sums import SumStatistics, sums_table
from ndtorch.vision.features import GROUPS
from tests.binding.readout.three_lights import MIXING, count, lights


@pytest.mark.parametrize("faint", [1.0, 0.25, 0.1])
def test_a_faint_thing_is_an_object(faint: float) -> None:
    weight = torch.tensor([1.0, 1.0, faint])
    assert count(SumStatistics()(100 * (lights(8) * weight) @ MIXING)) == 3


def test_what_has_left_is_no_object_soon_after() -> None:
    light = lights(20)
    light[1200:, 1] = 0.0
    sums = 100 * light @ MIXING
    assert count(SumStatistics()(sums[:1200])) == 3
    assert count(SumStatistics()(sums)) == 2


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


def test_scenes_in_a_batch_are_told_apart_as_each_alone() -> None:
    """Of one, two and three things; of the last one leaves."""
    light = lights(14).expand(3, -1, -1) * torch.tensor([[1.0, 0, 0], [1, 1, 0], [1, 1, 1]])[:, None]
    light[2, 800:, 1] = 0.0
    sums, nothing = 100 * light @ MIXING, torch.zeros(10, 10)
    none = ObjectTable(torch.zeros(3, 10, dtype=torch.bool), torch.zeros(3, 10, 10))
    together, changed, _ = sums_table(none, nothing.expand(3, -1, -1), SumStatistics()(sums), nothing)
    assert together.owners.sum(-1).tolist() == [1, 2, 2]
    assert changed.tolist() == [False, False, True]
    for scene, owners, rows in zip(sums, *together, strict=True):
        alone = sums_table(ObjectTable(*(part[0] for part in none)), nothing, SumStatistics()(scene), nothing).table
        assert torch.equal(alone.owners, owners)
        torch.testing.assert_close(alone.rows, rows, rtol=1e-3, atol=1e-5)


def test_objects_in_step_are_two_where_no_single_object_has_their_features() -> None:
    """One moves right and one left; both brighten at once, or one darkens while the other brightens."""
    light = lights(20)[:, :1]
    assert count(SumStatistics()(100 * light @ MIXING[:1])) == 1
    assert count(SumStatistics()(100 * light @ (MIXING[:1] + MIXING[1:2]))) == 2
    assert count(SumStatistics()(100 * (light @ MIXING[:1] + (2 - light) @ MIXING[1:2]))) == 2
    # Neither sign nor motion says that these are two.
    assert count(SumStatistics()(100 * light @ (MIXING[:1] + MIXING[2:]))) == 1


def test_rounding_of_a_constant_level_is_nothing() -> None:
    generator = torch.Generator().manual_seed(0)
    last_digit = torch.randint(-1, 2, (300, 10), generator=generator) * torch.finfo(torch.float32).eps
    assert count(SumStatistics(0.05)(1e4 * (1 + last_digit))) == 0
    # What rounding leaves at a delay may have no inverse: colors like that explain nothing of the orientations.
    colors = torch.tensor([[0.0, -0.25, -0.125], [-0.25, 0.0, 0.0], [-0.125, 0.0, 0.0]], dtype=torch.float64)
    delayed = torch.rand(1, 10, 10, generator=generator, dtype=torch.float64)
    orientations = GROUPS["orientation"]
    assert torch.equal(beside(delayed, colors, colors, 1e-6), delayed[:, orientations, orientations])


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
