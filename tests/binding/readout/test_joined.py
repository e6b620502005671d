"""Reading objects out: owners, delays, both joined, and the whole scale-free model."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import ndtorch
from ndtorch.binding import load_state, save_state
from ndtorch.binding.readout.delays import DelayStatistics, diagonalise, separate
from ndtorch.binding.readout.owners import SignalStatistics, distinct
from ndtorch.errors import InputError
from ndtorch.tree import leaves
from ndtorch.vision import LowPass
from ndtorch.vision.blocks import BlockLowPass, low_pass
from tests.strategies import chunkings

BARS = torch.zeros(2, 10)
BARS[0, [1, 2, 4, 6, 7]] = torch.tensor([1.0, 0.6, 0.7, 0.7, 0.9])
BARS[1, [0, 2, 4, 5, 8]] = torch.tensor([1.0, 0.6, 0.7, 0.7, 0.9])


def two_things(seconds: float, fps: float = 100.0, rates: tuple[float, float] = (0.87, 1.31)) -> torch.Tensor:
    """Sums of two bars that fluctuate at their own rates, `[T, 10]`."""
    t = torch.arange(round(seconds * fps)) / fps
    light = torch.stack([1 + 0.5 * torch.sin(2 * math.pi * rate * t + 2.1 * n) for n, rate in enumerate(rates)], -1)
    return 100 * light @ BARS


@settings(max_examples=20, deadline=None)
@given(a=st.floats(0.001, 1.0), lengths=chunkings(130))
def test_block_low_pass_is_the_loop(a: float, lengths: list[int]) -> None:
    signals = torch.randn(130, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    expected, low = [], signals[0]
    for sample in signals:
        low = low + a * (sample - low)
        expected.append(low)
    state, parts = signals[0], []
    for chunk in torch.split(signals, lengths):
        out, state = low_pass(BlockLowPass(a, 50), chunk, state)
        parts.append(out)
    assert_allclose(torch.cat(parts), torch.stack(expected), atol=1e-12)
    module, _ = LowPass(1 / a - 1, 1.0, 1)(signals)
    assert_allclose(torch.cat(parts), module, atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.integers(2, 6))
def test_common_diagonal_is_found(seed: int, size: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    basis = torch.linalg.qr(torch.randn(1, size, size, generator=generator, dtype=torch.float64)).Q
    diagonal = torch.randn(1, 4, size, generator=generator, dtype=torch.float64)
    rotation, result = diagonalise(basis.unsqueeze(1) @ torch.diag_embed(diagonal) @ basis.mT.unsqueeze(1))
    assert_allclose(rotation.mT @ rotation, torch.eye(size).expand(1, size, size), atol=1e-9)
    assert_allclose(result, torch.diag_embed(result.diagonal(dim1=-2, dim2=-1)), atol=1e-5)


def test_delays_find_the_mixing_of_known_sources() -> None:
    t = torch.arange(4000, dtype=torch.float64) / 100
    light = torch.stack([torch.sin(5 * t), torch.sin(9 * t + 1), torch.sign(torch.sin(3.3 * t))], -1)
    mixing = torch.rand(3, 10, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    state = DelayStatistics()(light @ mixing)
    found = separate(state.slow)
    assert int(found.sources) == 3
    likeness = (
        torch.nn.functional.normalize(found.mixing[:3].double(), dim=-1) @ torch.nn.functional.normalize(mixing).T
    )
    assert_allclose(likeness.amax(-1), torch.ones(3), atol=0.01)
    assert sorted(likeness.argmax(-1).tolist()) == [0, 1, 2]


def test_white_noise_is_not_in_the_delayed_covariances() -> None:
    noise = torch.randn(20000, 4, generator=torch.Generator().manual_seed(0))
    state = DelayStatistics(tau_slow=60.0)(noise)
    assert state.slow.abs().max() < 0.1


def test_equal_rates_are_said_to_be_indistinct() -> None:
    t = torch.arange(3000) / 100
    light = torch.stack([torch.sin(5 * t), torch.sin(5 * t + 1.5)], -1)
    gap = separate(DelayStatistics()(light @ BARS).slow).gap
    other = separate(DelayStatistics()(two_things(30) / 100).slow).gap
    assert gap < 0.02 < other


def test_nothing_is_no_source() -> None:
    assert int(separate(DelayStatistics()(torch.zeros(200, 10)).slow).sources) == 0


@settings(max_examples=10, deadline=None)
@given(lengths=chunkings(230))
def test_statistics_do_not_depend_on_chunks(lengths: list[int]) -> None:
    signals = torch.randn(230, 10, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    for module in (SignalStatistics(), DelayStatistics()):
        state = None
        for chunk in torch.split(signals, lengths):
            state = module(chunk, state)
        for one, other in zip(state, module(signals), strict=True):
            assert torch.equal(one, other)


def test_signal_statistics_are_the_weighted_means() -> None:
    # Whole tenths of a second count: the last five samples have to wait.
    signals = torch.randn(65, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    state = SignalStatistics(tau=0.5, tau_high=math.inf)(signals)
    a = 0.01 / 0.51
    expected = sum(a * (1 - a) ** (59 - n) * torch.outer(x, x) for n, x in enumerate(signals[:60]))
    assert_allclose(state.covariance, expected, atol=1e-12)


def test_copies_of_stronger_owners_are_left_out() -> None:
    strength = torch.tensor([1.0, 3.0, 2.0])
    alike = torch.tensor([[1, 0, 0], [0, 1, 1], [0, 1, 1]]).bool()
    assert distinct(torch.tensor([True, True, True]), strength, alike).tolist() == [True, True, False]
    assert distinct(torch.tensor([True, False, True]), strength, alike).tolist() == [True, False, True]


@pytest.mark.parametrize("readout", ["owners", "delays"])
@pytest.mark.parametrize("fps", [12.5, 30.0, 100.0])
def test_two_things_are_two_objects_at_any_rate(readout: str, fps: float) -> None:
    model = ndtorch.load("scale-free", size=(12, 14), fps=fps, readout=readout)
    _, state = model.from_sums(two_things(20, fps))
    found = model.objects(state)
    assert len(found) == 2
    colors = [{name for name in thing.features if name in ("red", "green", "blue")} for thing in found]
    assert sorted(map(sorted, colors)) == [["green"], ["red"]]
    by_color = {next(iter(c)): set(thing.features) for c, thing in zip(colors, found, strict=True)}
    assert "right" in by_color["red"] - by_color["green"]
    assert "left" in by_color["green"] - by_color["red"]


def test_attention_reads_the_same_table() -> None:
    model = ndtorch.load("scale-free", size=(12, 14))
    _, state = model.from_sums(two_things(15))
    table = model.second.table(state.second)
    assert table.owners.sum() == len(model.objects(state)) > 0
    assert torch.equal(model.table(state).rows, table.rows)


def test_a_constant_scene_has_no_objects() -> None:
    model = ndtorch.load("scale-free", size=(12, 14))
    _, state = model.from_sums(100 * torch.rand(1, 10, generator=torch.Generator().manual_seed(0)).expand(500, 10))
    assert model.verdict(state) == "static"
    assert model.objects(state) == []
    assert not model.second.table(state.second).owners.any()


def test_white_noise_has_no_objects() -> None:
    noise = torch.randn(1500, 10, generator=torch.Generator().manual_seed(0))
    model = ndtorch.load("scale-free", size=(12, 14))
    assert model.objects(model.from_sums(100 + noise)[1]) == []


def test_a_saved_run_goes_on_bit_for_bit(tmp_path: Path) -> None:
    model, sums = ndtorch.load("scale-free", size=(12, 14), fps=30.0), two_things(6, 30.0)
    _, state = model.from_sums(sums[:100])
    save_state(state, tmp_path / "state.safetensors")
    loaded, _ = load_state(tmp_path / "state.safetensors", model)
    assert loaded.first is None
    (one, end), (other, again) = model.from_sums(sums[100:], state), model.from_sums(sums[100:], loaded)
    assert torch.equal(one.outputs, other.outputs)
    for a, b in zip(leaves(end).values(), leaves(again).values(), strict=True):
        assert torch.equal(a, b)


def test_a_batch_of_models_is_that_many_models() -> None:
    model = ndtorch.load("scale-free", size=(12, 14))
    many = torch.stack([two_things(8, rates=(0.6 + 0.1 * n, 1.5)) for n in range(3)])
    signals, state = model.from_sums(many)
    alone, end = model.from_sums(many[1])
    assert_allclose(signals.outputs[1], alone.outputs, atol=1e-4)
    assert torch.equal(model.second.table(state.second).owners[1], model.second.table(end.second).owners)


def test_bad_options_are_refused() -> None:
    with pytest.raises(InputError, match="readout = 'both': Input should be 'owners' or 'delays'"):
        ndtorch.load("scale-free", readout="both")
    with pytest.raises(InputError, match="delays must be positive"):
        DelayStatistics(delays=(0.0,))
