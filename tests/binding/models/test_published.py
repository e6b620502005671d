"""The two-stage model: the parts in a row, time steps, pauses and batches."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import ndtorch
from ndtorch.binding import (
    BindingInputs,
    FirstStage,
    InhibitoryNetwork,
    LearningRule,
    PublishedModel,
    bound_objects,
    learning_rule,
    object_table,
)
from ndtorch.binding.models.whole_field import BindingSignals, BindingState
from ndtorch.binding.rules import RULES
from ndtorch.errors import InputError
from ndtorch.utils.tensors import leaves
from ndtorch.vision import GROUPS, VisualFeatures
from tests.binding.models.small_published import first_stage, model, noise, two_things
from tests.strategies import chunkings


def run(module: PublishedModel, frames: torch.Tensor, lengths: list[int] | int) -> tuple[BindingSignals, BindingState]:
    parts, state = [], None
    for chunk in frames.split(lengths, -4):
        signals, state = module(chunk, state)
        parts.append(signals)
    assert state is not None
    joined = [torch.cat(p, -1 if p[0].ndim == 1 else -2) for p in zip(*parts, strict=True)]
    return BindingSignals(*joined), state


def assert_same(got: tuple, expected: tuple, atol: float = 1e-5) -> None:
    for a, b in zip(got, expected, strict=True):
        assert_allclose(a, b, rtol=1e-5, atol=atol)


def test_signals_are_those_of_the_parts_in_a_row() -> None:
    frames = noise(40, 3, 12, 14)
    signals, state = model()(frames)
    sums, motion = VisualFeatures((12, 14))(frames)
    (inputs, scale), _ = BindingInputs(window=0.5)(sums)
    first = InhibitoryNetwork(10, rule=None, tau_in=math.inf, initial=first_stage())
    refined, _ = first(inputs)
    second = InhibitoryNetwork(10, rule=learning_rule("competitive", gamma=5.0, tau_onset=0.1), settle=0.1, window=0.2)
    outputs, end = second(refined)
    time = torch.arange(40, dtype=torch.float64) * 0.01
    assert_same(signals, (sums, inputs, refined, outputs, scale, time))
    assert_allclose(state.second.weights, end.weights, atol=1e-6)
    assert_allclose(state.motion[0], motion[0], atol=1e-6)
    assert end.weights.any()


def test_from_sums_equals_forward() -> None:
    module, frames = model(), noise(30, 3, 12, 14)
    signals, state = module(frames)
    sums, _ = module.features(frames)
    again, end = module.from_sums(sums)
    assert_same(again, signals, 0)
    assert torch.equal(end.second.weights, state.second.weights)
    assert end.motion is None


@pytest.mark.parametrize("fps", [12.5, 30.0, 100.0, 120.0])
def test_any_frame_rate_is_brought_to_the_networks_step(fps: float) -> None:
    module, frames = model(fps=fps), noise(25, 3, 12, 14)
    signals, state = module(frames)
    count = math.floor(24 / fps * 100 + 1e-6) + 1
    assert signals.outputs.shape == (count, 10)
    assert_allclose(signals.time, np.arange(count) * 0.01)
    assert int(state.second.steps) == int(state.first.steps) == count
    sums, _ = VisualFeatures((12, 14), 1 / fps)(frames)
    for column, expected in zip(signals.sums.T, sums.T, strict=True):
        interpolated = np.interp(np.arange(count) * 0.01, np.arange(25) / fps, expected)
        assert_allclose(column, interpolated, rtol=1e-4, atol=1e-4)


@settings(max_examples=12, deadline=None)
@given(fps=st.sampled_from([12.5, 30.0, 100.0, 120.0, 240.0]), lengths=chunkings(24))
def test_chunks_and_pauses_do_not_matter(fps: float, lengths: list[int]) -> None:
    module, frames = model(fps=fps), noise(24, 3, 12, 14)
    whole, end = module(frames)
    parts, part_end = run(module, frames, lengths)
    assert_same(parts, whole)
    one, other = leaves(part_end), leaves(end)
    assert one.keys() == other.keys()
    for name, part in one.items():
        assert_allclose(part, other[name], rtol=1e-4, atol=1e-5, err_msg=name)


def test_a_pause_changes_no_bit() -> None:
    module, frames = model(), noise(40, 3, 12, 14)
    _, state = module(frames[:20])
    states = [state, BindingState(*(type(part)(*(x.clone() for x in part)) for part in state))]
    (one, a), (other, b) = (module(frames[20:], s) for s in states)
    assert all(torch.equal(x, y) for x, y in zip(one, other, strict=True))
    assert torch.equal(a.second.weights, b.second.weights)


def test_time_goes_on_in_the_next_chunk() -> None:
    module = model(fps=50.0)
    _, state = module(noise(10, 3, 12, 14))
    signals, _ = module(noise(2, 3, 12, 14), state)
    assert_allclose(signals.time, [0.19, 0.2, 0.21, 0.22])


def test_a_frame_between_two_steps_gives_no_row() -> None:
    module = model(fps=240.0)
    _, state = module(noise(1, 3, 12, 14))
    signals, after = module(noise(1, 3, 12, 14, seed=1), state)
    assert [part.shape[0] for part in signals] == [0] * 6
    assert int(after.second.steps) == 1
    assert int(after.resample.taken) == 2
    assert not torch.equal(after.motion.slow, state.motion.slow)


@pytest.mark.parametrize("batch", [(2,), (2, 2)])
def test_a_batch_is_that_many_single_runs(batch: tuple[int, ...]) -> None:
    module, frames = model(fps=60.0), noise(*batch, 20, 3, 12, 14)
    signals, state = module(frames)
    assert signals.outputs.shape == (*batch, 32, 10)
    assert state.second.weights.shape == (*batch, 10, 10)
    last = tuple(n - 1 for n in batch)
    alone, end = module(frames[last])
    assert_same([part[last] for part in signals[:5]], alone[:5])
    assert_allclose(state.second.weights[last], end.second.weights, atol=1e-5)


def test_uint8_frames_are_scaled() -> None:
    frames = torch.randint(0, 256, (10, 3, 12, 14), dtype=torch.uint8)
    assert_allclose(model()(frames)[0].sums, model()(frames / 255)[0].sums, rtol=1e-4, atol=1e-4)


def test_the_first_stage_never_learns() -> None:
    _, state = model()(noise(60, 3, 12, 14))
    assert torch.equal(state.first.weights, first_stage())


def test_two_fluctuating_things_become_two_objects() -> None:
    module = model(gamma=2.0, settle=1.0, tau_onset=2.0, window=2.0, stable_window=1.0)
    _, state = module.from_sums(two_things(30))
    assert module.verdict(state) in ("stable", "learning")
    found, model_table = module.objects(state), object_table(state.second.weights)
    assert [thing.neuron for thing in found] != []
    assert found == bound_objects(model_table)


def test_a_constant_scene_is_static() -> None:
    module = model()
    signals, state = module(noise(1, 3, 12, 14).expand(80, 3, 12, 14))
    assert module.verdict(state) == "static"
    assert module.objects(state) == []
    # Sums over many pixels differ by rounding from chunk to chunk, which the floor holds down.
    assert signals.outputs.abs().max() < 1e-3
    assert not signals.sums[:, :4].any()


def test_a_constant_scene_of_sums_gives_exactly_nothing() -> None:
    module = model()
    signals, state = module.from_sums(noise(1, 10).expand(200, 10))
    assert not signals.inputs.any()
    assert not signals.outputs.any()
    assert not state.second.weights.any()
    assert module.verdict(state) == "static"


def test_one_group_alone_is_nothing_to_bind() -> None:
    sums = torch.full((100, 10), 100.0)
    sums[:, 7:] = two_things(1)[:, 7:]
    module = model()
    assert module.verdict(module.from_sums(sums)[1]) == "static"


def test_a_state_of_frames_goes_on_with_sums() -> None:
    module, frames = model(), noise(20, 3, 12, 14)
    whole, _ = module(frames)
    _, state = module(frames[:10])
    signals, end = module.from_sums(whole.sums[10:], state)
    assert_allclose(signals.outputs, whole.outputs[10:], atol=1e-6)
    assert end.motion is state.motion


def test_a_trained_first_stage_is_taken_as_it_is() -> None:
    stage = FirstStage(*(first_stage()[group, group] for group in GROUPS.values()), seconds=7.0)
    assert torch.equal(PublishedModel(first_stage=stage).first_stage(), first_stage())


def test_a_rule_of_ones_own_is_used() -> None:
    frames, rule = noise(40, 3, 12, 14), LearningRule(torch.sin, torch.cos, "mine")
    config = model().config
    _, state = PublishedModel(config, first_stage(), rule=rule)(frames)
    assert not torch.equal(state.second.weights, model()(frames)[1].second.weights)


def test_a_rule_given_as_an_object_is_not_saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine = PublishedModel(model().config, first_stage(), rule=LearningRule(torch.sin, torch.cos, "mine"))
    with pytest.raises(InputError, match=r"rule 'mine' was given as an object.*RULES\['mine'\] = lambda \*\*constants"):
        mine.save(tmp_path / "model")
    known = PublishedModel(model().config, first_stage(), rule=learning_rule("competitive", gamma=2.0))
    with pytest.raises(InputError, match=r"rule 'competitive' was given as an object.*RULES\['mine'\]"):
        known.save(tmp_path / "model")
    with pytest.raises(InputError, match=r"gamma was given for every trial, .*: set it in the config"):
        PublishedModel(model().config, first_stage(), gamma=torch.tensor([0.1, 0.2])).save(tmp_path / "model")
    assert not (tmp_path / "model").exists()

    # As the message says.
    def maker(gamma: float, tau_onset: float, radius_limit: float, **_: Any) -> LearningRule:
        return LearningRule(torch.sin, torch.cos, "mine", gamma, tau_onset, radius_limit)

    monkeypatch.setitem(RULES, "mine", maker)
    named, frames = model(rule="mine"), noise(40, 3, 12, 14)
    named.save(tmp_path / "model")
    weights = ndtorch.load(tmp_path / "model")(frames)[1].second.weights
    assert torch.equal(weights, named(frames)[1].second.weights)
    assert not torch.equal(weights, model()(frames)[1].second.weights)


def test_all_fixed_tensors_are_in_the_state_dict() -> None:
    module, other = model(), PublishedModel(model().config, torch.zeros(10, 10))
    assert "first.initial" in module.state_dict()
    other.load_state_dict(module.state_dict())
    frames = noise(20, 3, 12, 14)
    assert_same(other(frames)[0], module(frames)[0], 0)
    assert torch.equal(other.first_stage(), first_stage())
