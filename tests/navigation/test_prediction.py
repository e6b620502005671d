"""Features that are looked for where they were, against plain loops."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.navigation import FeatureParams
from ndtorch.navigation.stereo.features import find_features
from ndtorch.navigation.stereo.prediction import PredictedFeatures
from tests.navigation.test_row_features import rows


def bumps(places, width=80, heights=(0.5, 0.4, 0.3)):
    motion = torch.zeros(width)
    for place, height in zip(places, heights, strict=False):
        motion[place] = height
    return motion


def test_prediction_follows_and_extrapolates():
    """Two bumps swap strength; the slots stay with the objects, at 2 pixels a row."""
    steps = [bumps([20 + 2 * t, 60 - t], heights=(0.5, 0.4) if t % 2 else (0.4, 0.5)) for t in range(8)]
    motion = torch.stack(steps)
    params = FeatureParams(count=2, min_difference=0.0)
    found, state = PredictedFeatures(params)(torch.rand(8, 80), motion)
    first = found.column[0].tolist()
    order = [first.index(20), first.index(60)]
    assert found.column[:, order[0]].tolist() == [20 + 2 * t for t in range(8)]
    assert found.column[:, order[1]].tolist() == [60 - t for t in range(8)]
    assert (2 * state.last - state.before)[order[0]] == 36


def test_prediction_reaches_three_pixels_and_refills():
    row = torch.rand(2, 80)
    near = PredictedFeatures(FeatureParams(count=1, min_difference=0.0))(
        row, torch.stack([bumps([20]), bumps([23, 60], heights=(0.1, 0.5))])
    )[0]
    assert near.column[:, 0].tolist() == [20, 23]  # kept, though there is a stronger one
    far = PredictedFeatures(FeatureParams(count=1, min_difference=0.0))(
        row, torch.stack([bumps([20]), bumps([24, 60], heights=(0.1, 0.5))])
    )[0]
    assert far.column[:, 0].tolist() == [20, 60]  # lost, refilled from the whole row


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_prediction_keeps_the_spacing_and_chunks(seed):
    row, motion = rows(seed, 2, 12, 60)
    tracker = PredictedFeatures()
    whole, _ = tracker(row, motion)
    gaps = (whole.column.unsqueeze(-1) - whole.column.unsqueeze(-2)).abs() + torch.eye(5).long() * 99
    assert gaps.min() > 3
    state, columns = None, []
    for a, b in zip(row.split(5, 1), motion.split(5, 1), strict=True):
        part, state = tracker(a, b, state)
        columns.append(part.column)
    assert torch.equal(torch.cat(columns, 1), whole.column)
    assert torch.equal(whole.column[:, 0], find_features(row[:, 0], motion[:, 0]).column)
