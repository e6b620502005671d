"""Read-outs: number, confidence and features of sources in sums."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from ndtorch.binding.models.retinotopic import owner_column
from ndtorch.binding.network import settled
from ndtorch.binding.sources import SourceEstimator, SourceState, diagonalise
from ndtorch.vision import FEATURES, GROUPS
from ndtorch.vision.temporal import LowPass

NONE = torch.zeros(10, 10)
RATE = 50
COLORS = torch.tensor([[1.0, 0.2, 0.1], [0.1, 1.0, 0.3], [0.2, 0.1, 1.0], [0.7, 0.6, 0.1]])
DIRECTIONS = torch.eye(4)[:, [1, 0, 2, 3]]
TILTS = torch.tensor([[1.0, 0.2, 0.2], [0.2, 1.0, 0.2], [0.2, 0.2, 1.0], [0.8, 0.8, 0.2]])


def sums(bars: int, seconds: float = 20.0, noise: float = 0.0, one_hue: bool = False, ground: float = 0.0) -> Tensor:
    """Ten sums of bars by the formulas of the features: `s LP s` for motion, s for orientations and colors."""
    t = torch.arange(round(seconds * RATE), dtype=torch.float64) / RATE
    light = (
        1 + 0.5 * torch.stack([(5 * t).sin(), (9 * t + 1).sin(), (3.3 * t).sin(), (7.1 * t + 2).sin()], -1)[:, :bars]
    )
    slow, _ = LowPass(0.05, 1 / RATE, 1)(light)
    color = COLORS[:1].expand(bars, 3) if one_hue else COLORS[:bars]
    parts = [light * slow @ DIRECTIONS[:bars].double(), light @ TILTS[:bars].double(), light @ color.double()]
    clean = 100 * torch.cat(parts, -1)
    clean[:, GROUPS["color"]] += ground
    return (clean + noise * torch.randn(clean.shape, generator=torch.Generator().manual_seed(1))).float()


def after(signals: Tensor) -> tuple[SourceEstimator, SourceState]:
    estimator = SourceEstimator(1 / RATE, NONE)
    return estimator, estimator(signals)


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("bars", [1, 2, 3, 4])
def test_bars_are_counted(bars: int, noise: float) -> None:
    estimator, state = after(sums(bars, noise=noise))
    assert int(estimator.number(state)) == bars


def test_two_bars_of_one_hue_are_told_by_their_motion() -> None:
    estimator, state = after(sums(2, one_hue=True))
    assert int(estimator.number(state)) == 2
    assert float(estimator.confidence(state)) < 0.9


def test_a_lit_ground_adds_no_bar() -> None:
    estimator, state = after(sums(2, ground=1e4))
    assert int(estimator.number(state)) == 2
    _, dark = after(sums(2))
    assert float(estimator.confidence(state)) < float(estimator.confidence(dark))


def test_what_has_left_is_forgotten() -> None:
    both, one = sums(2, 40), sums(1, 40)
    both[20 * RATE :] = one[20 * RATE :]
    estimator, state = after(both)
    assert int(estimator.number(state)) == 1


@pytest.mark.parametrize("signals", [torch.full((600, 10), 3.0), torch.rand(600, 10), torch.zeros(600, 10)])
def test_constants_and_white_noise_are_no_source(signals: Tensor) -> None:
    estimator, state = after(signals)
    assert int(estimator.number(state)) == 0
    assert not estimator.table(state, torch.zeros(*state.votes.shape[:-1], 10, 10)).owners.any()


def test_features_are_those_of_each_bar() -> None:
    estimator, state = after(sums(3, noise=0.5))
    table = estimator.table(state, torch.zeros(*state.votes.shape[:-1], 10, 10))
    rows = {FEATURES[int(row[7:].argmax()) + 7]: row for row in table.rows[table.owners]}
    assert set(rows) == {"red", "green", "blue"}
    for name, motion, tilt in (("red", "right", "0°"), ("green", "left", "60°"), ("blue", "down", "120°")):
        present = {FEATURES[k] for k in (rows[name] > 0).nonzero().flatten().tolist()}
        assert {name, motion, tilt} == present - {"red", "green", "blue"} | {name}


def test_scenes_in_a_batch_are_counted_as_each_alone() -> None:
    estimator, state = after(torch.stack([sums(1), sums(2), sums(3)]))
    assert estimator.number(state).tolist() == [1, 2, 3]
    assert estimator.table(state, torch.zeros(*state.votes.shape[:-1], 10, 10)).owners.sum(-1).tolist() == [1, 2, 3]


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.integers(2, 5))
def test_a_common_diagonal_is_found(seed: int, size: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    rotation = torch.linalg.qr(torch.randn(size, size, generator=generator, dtype=torch.float64))[0]
    diagonals = torch.rand(6, size, generator=generator, dtype=torch.float64)
    found = diagonalise(rotation @ torch.diag_embed(diagonals) @ rotation.mT)
    agreement = (rotation.mT @ found).abs()
    torch.testing.assert_close(agreement.amax(0), torch.ones(size).double(), rtol=1e-6, atol=1e-6)


def covariances(**features: float) -> Tensor:
    """Covariances of signals that all go with one light."""
    strength = torch.zeros(10)
    for name, value in features.items():
        strength[FEATURES.index(name)] = value
    return strength[:, None] * strength


def test_the_strongest_owns_a_single_object() -> None:
    # Motion is in other units, and counts by its own largest.
    owner, column = owner_column(covariances(right=500.0, down=300.0, red=2.0, green=0.2), NONE)
    assert FEATURES[int(owner)] == "right"
    assert column[FEATURES.index("down")] == pytest.approx(0.6)
    assert column[FEATURES.index("red")] == pytest.approx(1.0)


def test_the_first_stage_is_taken_into_account() -> None:
    first = torch.zeros(10, 10)
    first[GROUPS["color"], GROUPS["color"]] = 0.4 - 0.4 * torch.eye(3)
    given_covariances = covariances(right=1.0, red=1.0, green=0.9)
    gain = settled(first)
    owner, column = owner_column(given_covariances, first)
    torch.testing.assert_close(column, (gain @ given_covariances @ gain.mT)[:, int(owner)])
