"""Scores of objects against the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from ndtorch_train.benchmark.scene_scores import feature_f1, right_from, score_scene


def features(*rows: str) -> torch.Tensor:
    """Bool rows from strings of 0 and 1."""
    return torch.tensor([[c == "1" for c in row] for row in rows], dtype=torch.bool).reshape(len(rows), 10)


def test_f1_gives_objects_to_bars_as_fits_best() -> None:
    truth = features("1100000100", "0011000010")
    assert feature_f1(truth[[1, 0]], truth).tolist() == [1.0, 1.0]
    # One object for two bars: the other bar has 0. Two of three features right, one wrong: F1 = 2/3.
    assert feature_f1(features("1000100100"), truth).tolist() == pytest.approx([2 / 3, 0.0])
    assert feature_f1(truth[:0], truth).tolist() == [0.0, 0.0]


def test_a_scene_is_ok_when_counted_and_described() -> None:
    truth = features("1100000100", "0011000010")
    assert score_scene(truth, truth).ok
    surplus = score_scene(torch.cat([truth, truth[:1]]), truth)
    assert (surplus.counted, surplus.ok, surplus.f1) == (False, False, 1.0)
    nothing = truth[:0]
    assert score_scene(nothing, nothing).ok
    assert not score_scene(truth, nothing).counted


def test_right_from_is_the_start_of_the_lasting_right_count() -> None:
    times = np.arange(1.0, 6.0)
    assert right_from(times, np.array([1, 2, 1, 2, 2]), 2) == 4.0
    assert right_from(times, np.array([2, 2, 2, 2, 2]), 2) == 1.0
    assert right_from(times, np.array([2, 2, 2, 2, 1]), 2) == math.inf
