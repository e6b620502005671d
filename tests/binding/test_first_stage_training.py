"""Training on rings: where each network stops, and what comes of it."""

from __future__ import annotations

import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.binding import FirstStage, spectral_radius, train_first_stage
from ndtorch.binding.first_stage import block_diagonal
from ndtorch.errors import InputError
from ndtorch.vision import GROUPS

SMALL = {"gamma": 50.0, "settle": 1.0, "size": (64, 64)}


@pytest.fixture(scope="module")
def stage() -> FirstStage:
    return train_first_stage(radius=0.5, **SMALL)


def test_every_network_stops_at_the_radius(stage: FirstStage) -> None:
    for weights in stage[:3]:
        assert float(spectral_radius(weights)) == pytest.approx(0.5, rel=1e-4)
        assert float(spectral_radius(weights)) <= 0.5 * (1 + 1e-6)


def test_weights_have_their_shapes_and_bounds(stage: FirstStage) -> None:
    assert [weights.shape for weights in stage[:3]] == [(4, 4), (3, 3), (3, 3)]
    for weights in stage[:3]:
        assert (weights >= 0).all()
        assert not weights.diagonal().any()


def test_colors_of_white_rings_get_equal_weights(stage: FirstStage) -> None:
    assert_allclose(stage.color[~torch.eye(3, dtype=torch.bool)], 0.25, atol=1e-3)


def test_seconds_count_settling_and_learning(stage: FirstStage) -> None:
    assert 1.0 < stage.seconds < 20


def test_progress_is_told_time_and_largest_weights() -> None:
    seen: list[tuple[float, list[float]]] = []
    stage = train_first_stage(radius=0.2, report=lambda t, w: seen.append((t, w)), **SMALL)
    times = [t for t, _ in seen]
    assert times == sorted(times)
    assert times[-1] == pytest.approx(stage.seconds)
    assert seen[-1][1] == pytest.approx([float(w.max()) for w in stage[:3]])


def test_block_diagonal_keeps_the_groups_apart() -> None:
    stage = FirstStage(torch.full((4, 4), 1.0), torch.full((3, 3), 2.0), torch.full((3, 3), 3.0), 1.0)
    weights = block_diagonal(stage)
    assert weights.shape == (10, 10)
    for value, group in enumerate(GROUPS.values(), 1):
        assert (weights[group, group] == value).all()
    assert weights.sum() == 16 + 18 + 27


@pytest.mark.parametrize("gamma", [0.0, -5.0, float("nan")])
def test_rates_out_of_range_are_refused(gamma: float) -> None:
    with pytest.raises(InputError, match="gamma must be positive"):
        train_first_stage(gamma=gamma)


@pytest.mark.parametrize("radius", [0.0, 1.0, -0.5, float("nan")])
def test_radii_out_of_range_are_refused(radius: float) -> None:
    with pytest.raises(InputError, match="spectral radius must lie between 0 and 1"):
        train_first_stage(radius=radius)


def test_training_that_does_not_get_there_says_so() -> None:
    with pytest.raises(InputError, match=r"did not reach a spectral radius of 0\.9 in 120 s; raise gamma"):
        train_first_stage(gamma=1e-9, dt=0.05, size=(16, 16))
