"""Telling sources apart in the sums as they are."""

from __future__ import annotations

import pytest
import torch

from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.source_count import beside
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
