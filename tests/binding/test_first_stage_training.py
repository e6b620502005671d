"""Training on rings: where each network stops, and what comes of it."""

from __future__ import annotations

import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.binding import FirstStage, spectral_radius, train_first_stage
from ndtorch.errors import InputError

SMALL = {"gamma": 50.0, "settle": 1.0, "size": (64, 64)}


@pytest.fixture(scope="module")
def stage() -> FirstStage:
    return train_first_stage(radius=0.5, **SMALL)


def test_every_network_stops_at_the_radius(stage: FirstStage) -> None:
    for weights in stage[:3]:
        assert float(spectral_radius(weights)) == pytest.approx(0.5, rel=1e-4)
        assert float(spectral_radius(weights)) <= 0.5 * (1 + 1e-6)


def test_colors_of_white_rings_get_equal_weights(stage: FirstStage) -> None:
    assert_allclose(stage.color[~torch.eye(3, dtype=torch.bool)], 0.25, atol=1e-3)


def test_training_that_does_not_get_there_says_so() -> None:
    with pytest.raises(InputError, match=r"did not reach a spectral radius of 0\.9 in 120 s; raise gamma"):
        train_first_stage(gamma=1e-9, dt=0.05, size=(16, 16))
