"""What the published model does not take."""

from __future__ import annotations

import math

import pytest
import torch

from ndtorch.binding import (
    PublishedModel,
)
from ndtorch.errors import InputError
from tests.binding.models.small_published import first_stage, model, noise


@pytest.mark.parametrize("fps", [0.0, -30.0, math.nan, math.inf])
def test_frame_rates_out_of_range_are_refused(fps: float) -> None:
    with pytest.raises(InputError, match="fps = "):
        model(fps=fps)


def bad_weights() -> list[torch.Tensor]:
    weights = [first_stage() for _ in range(4)]
    weights[0][0, 1], weights[1][0, 1] = -0.1, math.nan
    weights[2][0, 5], weights[3][2, 2] = 0.1, 0.1
    return weights


@pytest.mark.parametrize("weights", bad_weights())
def test_unusable_first_stage_weights_are_refused(weights: torch.Tensor) -> None:
    with pytest.raises(InputError, match="first-stage weights must be finite, non-negative, and zero on the diagonal"):
        PublishedModel(first_stage=weights)


def test_first_stage_weights_of_another_shape_are_refused() -> None:
    with pytest.raises(InputError, match=r"first_stage must be a FirstStage or weights \[10, 10\], got \(4, 4\)"):
        PublishedModel(first_stage=torch.zeros(4, 4))


def test_unknown_names_in_the_config_are_refused() -> None:
    with pytest.raises(InputError, match="rule must be one of"):
        model(rule="oja")
    with pytest.raises(InputError, match="g must be one of"):
        model(g="relu")


def test_frames_and_sums_that_do_not_fit_are_refused() -> None:
    module = model()
    with pytest.raises(InputError, match="frames must be 12x14"):
        module(torch.zeros(2, 3, 14, 12))
    with pytest.raises(InputError, match="frames must be finite"):
        module(torch.full((2, 3, 12, 14), math.nan))
    with pytest.raises(InputError, match=r"sums must be \[\.\.\., T, 10\]"):
        module.from_sums(torch.zeros(5, 9))
    with pytest.raises(InputError, match="sums must be finite"):
        module.from_sums(torch.full((5, 10), math.inf))


def test_a_state_of_sums_does_not_go_on_with_frames() -> None:
    module = model()
    _, state = module.from_sums(noise(5, 10))
    with pytest.raises(InputError, match="go on with from_sums"):
        module(noise(2, 3, 12, 14), state)
