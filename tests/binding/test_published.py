"""The published model: its parts, rates, chunks, and its verdict."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.binding import BindingInputs, InhibitoryNetwork, PublishedModel, learning_rule
from ndtorch.binding.models.whole_field import PublishedConfig
from ndtorch.config import with_options
from ndtorch.vision import GROUPS, VisualFeatures

QUICK = {"gamma": 5.0, "settle": 0.1, "tau_onset": 0.1, "window": 0.5, "stable_window": 0.2}


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def first_stage() -> torch.Tensor:
    weights = torch.zeros(10, 10)
    for group, value in zip(GROUPS.values(), (0.3, 0.45, 0.45), strict=True):
        weights[group, group] = value
    return weights.fill_diagonal_(0)


def model(**options: Any) -> PublishedModel:
    options = {"size": (12, 14), **QUICK, **options}
    return PublishedModel(with_options(PublishedConfig(), options), first_stage())


def two_things(seconds: float, fps: float = 100.0) -> torch.Tensor:
    """Sums of a red thing going right and a green one going left, a third of a period apart, `[T, 10]`."""
    t = torch.arange(round(seconds * fps)) / fps
    red, green = (1 + 0.5 * torch.sin(2 * math.pi * 0.87 * t + phase) for phase in (0.0, 2.1))
    features = torch.zeros(2, 10)
    features[0, [1, 2, 4, 6, 7]] = torch.tensor([1.0, 0.6, 0.7, 0.7, 0.9])
    features[1, [0, 2, 4, 5, 8]] = torch.tensor([1.0, 0.6, 0.7, 0.7, 0.9])
    return 100 * torch.stack([red, green], -1) @ features


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


def test_a_constant_scene_is_static() -> None:
    module = model()
    signals, state = module(noise(1, 3, 12, 14).expand(80, 3, 12, 14))
    assert module.verdict(state) == "static"
    assert module.objects(state) == []
    # Sums over many pixels differ by rounding from chunk to chunk, which the floor holds down.
    assert signals.outputs.abs().max() < 1e-3
    assert not signals.sums[:, :4].any()


@pytest.mark.parametrize(
    ("size", "parts", "verdict", "objects"),
    [
        (1.0, {}, "stable", ["red", "green"]),
        (1.0, {"changes": torch.full((20,), 0.03)}, "learning", ["red", "green"]),
        (0.5, {}, "learning", []),
        (1.0, {"power": torch.ones(10), "roughness": 3.9 * torch.ones(10)}, "alternating", []),
    ],
)
def test_verdicts(size: float, parts: dict[str, torch.Tensor], verdict: str, objects: list[str]) -> None:
    """Settled weights, weights that change, small ones, and outputs that flip."""
    module = model()
    _, state = module.from_sums(two_things(1))
    weights = torch.zeros(10, 10)
    weights[1, 7], weights[0, 8] = 0.8 * size, 0.7 * size
    second = state.second._replace(weights=weights, changes=torch.zeros_like(state.second.changes))
    state = state._replace(second=second._replace(**parts))
    assert module.verdict(state) == verdict
    assert [thing.neuron for thing in module.objects(state)] == objects


def test_a_batch_has_a_verdict_and_objects_a_trial() -> None:
    module = model(gamma=2.0, settle=1.0, tau_onset=2.0, window=2.0, stable_window=1.0)
    sums = torch.stack([two_things(20), torch.full((2000, 10), 3.0), two_things(20).roll(40, 0)])
    _, state = module.from_sums(sums)
    alone = [module.from_sums(trial)[1] for trial in sums]
    assert module.verdict(state) == [module.verdict(one) for one in alone]
    assert module.verdict(state)[1] == "static"
    names = [[thing.neuron for thing in trial] for trial in module.objects_batch(state)]
    assert names == [[thing.neuron for thing in module.objects(one)] for one in alone]
    assert names[0] != names[1] == []
    _, nested = module.from_sums(sums.unsqueeze(1).expand(-1, 2, -1, -1))
    assert module.verdict(nested) == [[word, word] for word in module.verdict(state)]
