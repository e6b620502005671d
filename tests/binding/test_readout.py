"""Read-outs: owners in sums, covariances, joint diagonalisation, memory, common fate."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from torch import Tensor

from ndtorch.binding.learning import settled
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.covariances import columns, single_table
from ndtorch.binding.readout.joint_diagonalisation import diagonalise, sources_of
from ndtorch.binding.readout.memory import AnswerMemory, count_confidence, each_confidence, no_answers, remember
from ndtorch.binding.readout.owners import SourceCriteria, SumCriteria
from ndtorch.binding.readout.source_count import beside, motion_residual, undisturbed
from ndtorch.binding.readout.sums import SumState, SumStatistics, sums_table
from ndtorch.vision import FEATURES, GROUPS

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
    return int(sums_table(none, torch.zeros(10, 10), statistics, torch.zeros(10, 10)).table.owners.sum())


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


NONE = torch.zeros(10, 10)


def seen(**features: float) -> Tensor:
    """Covariances of signals that all go with one light."""
    strength = torch.zeros(10)
    for name, value in features.items():
        strength[FEATURES.index(name)] = value
    return strength[:, None] * strength


def test_the_strongest_owns_and_its_column_is_what_fluctuates_with_it() -> None:
    # Motion is in other units, and counts by its own largest.
    covariances = seen(right=500.0, down=300.0, red=2.0, green=0.2)
    owner, column = columns(covariances, NONE)
    assert FEATURES[int(owner)] == "right"
    table = single_table(covariances, torch.tensor(True), NONE)
    assert table.owners.nonzero().tolist() == [[FEATURES.index("right")]]
    features = {name: round(v, 3) for name, v in zip(FEATURES, table.rows[owner].tolist(), strict=True) if v > 0}
    assert features == {"right": 1.0, "down": 0.6, "red": 1.0}
    assert single_table(covariances, torch.tensor(True), NONE, 0.05).rows[owner, FEATURES.index("green")] > 0
    assert column[FEATURES.index("down")] < column[owner]


def test_the_first_stage_is_taken_into_account() -> None:
    first = torch.zeros(10, 10)
    first[GROUPS["color"], GROUPS["color"]] = 0.4 - 0.4 * torch.eye(3)
    covariances = seen(right=1.0, red=1.0, green=0.9)
    gain = settled(first)
    owner, column = columns(covariances, first)
    expected = (gain @ covariances @ gain.mT)[:, int(owner)]
    assert torch.allclose(column, expected, atol=1e-6)


def test_a_group_of_its_own_way_speaks_for_itself_before_a_light_ground() -> None:
    # Color goes one way; motion and orientation the other, as the thing gets darker than what is behind it.
    strength, against = torch.zeros(10), torch.zeros(10)
    strength[FEATURES.index("red")], strength[FEATURES.index("green")] = 2.0, 0.2
    against[FEATURES.index("right")], against[FEATURES.index("60°")] = 1.0, 0.5
    mixed = strength - 0.8 * against
    covariances = mixed[:, None] * mixed + 0.01 * against[:, None] * against
    there = torch.tensor(True)
    dark, light = (single_table(covariances, there, NONE, apart=torch.tensor(apart)) for apart in (False, True))
    found = [{name for name, v in zip(FEATURES, t.rows.sum(-2).tolist(), strict=True) if v > 0} for t in (dark, light)]
    assert found[0] < found[1] == {"red", "right", "60°"}
    assert torch.equal(single_table(covariances, there, NONE).rows, dark.rows)


def of(count: int) -> ObjectTable:
    """A table of so many objects."""
    owners = torch.arange(10) < count
    return ObjectTable(owners, torch.diag(owners.float()))


def after(memory: AnswerMemory, counts: list[int], changed: bool = False) -> AnswerMemory:
    """The memory after those numbers of objects."""
    one, now = torch.tensor(1.0), torch.tensor(changed)
    for number in counts:
        memory = remember(memory, of(number), 2 * one, one, memory.steps + 100, 0.9, now)
    return memory


def test_an_object_that_was_certain_is_not_two_a_second_later() -> None:
    memory = after(no_answers(torch.zeros(10, 10)), 8 * [1])
    assert after(memory, [2, 2]).table.owners.sum() == 1
    assert after(memory, 10 * [2]).table.owners.sum() == 2
    assert after(memory, 3 * [2]).table.owners.sum() == 1
    assert after(memory, 3 * [2], changed=True).table.owners.sum() == 2


def test_confidence_falls_with_answers_that_disagree() -> None:
    memory = after(no_answers(torch.zeros(10, 10)), 20 * [2])
    doubted = after(memory, [2, 3, 2, 3])
    assert 0.9 < count_confidence(memory) <= 1
    assert count_confidence(doubted) < count_confidence(memory)
    sure = each_confidence(doubted)
    assert (sure[:2] > 0.5).all()
    assert not sure[2:].any()
    assert count_confidence(no_answers(torch.zeros(10, 10))) == 0


def test_motion_tells_a_fourth_source_from_three_colors() -> None:
    """A detector gives products of each brightness with its own past; three colors know those of three alone."""
    t = torch.arange(1600) / 100
    light = 1 + 0.5 * torch.stack([(5 * t).sin(), (9 * t + 1).sin(), (3.3 * t).sin(), (7.1 * t).sin()], -1)
    sums = torch.zeros(1600, 10)
    colors = torch.tensor([[1.0, 0.3, 0.1], [0.2, 1.0, 0.2], [0.1, 0.3, 1.0], [0.6, 0.5, 0.8]])
    residual = []
    for bars in (3, 4):
        statistics = SumStatistics()
        slow, _ = statistics.delay(light[:, :bars])
        sums[:, :4] = (light[:, :bars] * slow) @ torch.eye(4)[:bars]
        sums[:, 7:] = light[:, :bars] @ colors[:bars]
        residual.append(float(motion_residual(statistics(100 * sums).products)))
    assert residual[0] < 1e-3
    assert residual[1] > 0.05


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.integers(2, 6))
def test_common_diagonal_is_found(seed: int, size: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    basis = torch.linalg.qr(torch.randn(1, size, size, generator=generator, dtype=torch.float64)).Q
    diagonal = torch.randn(1, 4, size, generator=generator, dtype=torch.float64)
    rotation, result = diagonalise(basis.unsqueeze(1) @ torch.diag_embed(diagonal) @ basis.mT.unsqueeze(1))
    assert_allclose(rotation.mT @ rotation, torch.eye(size).expand(1, size, size), atol=1e-9)
    assert_allclose(result, torch.diag_embed(result.diagonal(dim1=-2, dim2=-1)), atol=1e-5)


def separated(sums: Tensor) -> tuple[int, Tensor, float]:
    """Number, mixing and gap of the sources in the long memory."""
    kept = undisturbed(SumStatistics()(sums).all, 12.0, 1.0, SumCriteria())
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


def covariances(*sources: tuple[float, list[float]]) -> torch.Tensor:
    """Of sources that do not know of each other, by their variance and their share of each signal, `[1, 10, 10]`."""
    total = torch.zeros(10, 10, dtype=torch.float64)
    for variance, share in sources:
        total += variance * torch.outer(*[torch.tensor(share, dtype=torch.float64)] * 2)
    return total[None]


STANDS = [0, 0, 0, 0, 0.2, 0.2, 0.2, 1, 1, 1]
MOVES = [0, 0.5, 0, 0, 0.2, 0.2, 0.2, 1, 1, 1]
BAR = [0, 1.0, 0, 0, 1, 0.3, 0, 1, 0, 0]
