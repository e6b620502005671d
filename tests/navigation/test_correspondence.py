"""Which feature of one row is which of the other."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.navigation import MatchParams
from ndtorch.navigation.stereo.correspondence import match_features
from ndtorch.navigation.stereo.features import Features, find_features
from tests.navigation.test_row_features import rows


def as_features(columns, patches, valid=None):
    columns = torch.tensor(columns)
    valid = torch.ones(len(columns), dtype=torch.bool) if valid is None else torch.tensor(valid)
    return Features(columns, torch.ones(len(columns)), torch.tensor(patches), valid)


def test_best_partner_first_window_second():
    """The best partner lies outside the window, so there is no match: not the second best inside."""
    left = as_features([400], [[0.1, 0.5, 0.9]])
    right = as_features([390, 300], [[0.1, 0.5, 0.9], [0.1, 0.5, 0.8]])
    assert not match_features(left, right).valid.any()
    right = as_features([390, 300], [[0.1, 0.5, 0.7], [0.1, 0.5, 0.8]])
    found = match_features(left, right)
    assert found.valid.all()
    assert found.right.tolist() == [300]
    assert found.error.tolist() == pytest.approx([0.01])


@pytest.mark.parametrize(("right", "valid"), [(340, False), (339, True), (201, True), (200, False), (500, False)])
def test_disparity_is_signed_and_its_window_open(right, valid):
    patch = [[0.1, 0.5, 0.9]]
    assert match_features(as_features([400], patch), as_features([right], patch)).valid.tolist() == [valid]


def test_one_to_one():
    left = as_features([400, 410], [[0.1, 0.5, 0.9], [0.1, 0.5, 0.8]])
    right = as_features([300], [[0.1, 0.5, 0.88]])
    assert match_features(left, right).valid.tolist() == [True, False]
    assert match_features(left, right, MatchParams(one_to_one=False)).valid.tolist() == [True, True]


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000))
def test_matches_properties(seed):
    row, motion = rows(seed, 2, 640)
    found = find_features(row, motion)
    ours, theirs = (Features(*(part[k] for part in found)) for k in (0, 1))
    matches = match_features(ours, theirs)
    disparity = (matches.left - matches.right)[matches.valid]
    assert ((disparity > 60) & (disparity < 200)).all()
    partners = matches.right[matches.valid].tolist()
    assert len(partners) == len(set(partners))
