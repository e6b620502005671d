"""The way since the start is gone through again once the odometer is known, and what was seen first finds its place."""

import math

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Pose, StereoRig
from ndtorch.navigation.localisation import Localiser, LocaliserParams
from ndtorch.navigation.localisation.anchors import anchor_of, located_frames
from ndtorch.navigation.localisation.graph import carried
from ndtorch.navigation.localisation.params import RetraceParams
from tests.navigation.localisation.test_parts import DT, Sighted, corridor, path, rounds

pytest.importorskip("numba")


def drive(after, every=1, steps=None, stand=0):
    """Rounds of a corridor with a wrong odometer: the last state, anchors, and how many scans were kept on the way."""
    driven = rounds(2)[:steps]
    true, reckoned = path(driven), path(driven, 0.05, 0.03, math.radians(0.1) * DT)
    true, reckoned = (np.concatenate((way[:1].repeat(stand, 0), way)) for way in (true, reckoned))
    localiser = Sighted(StereoRig(), DT, LocaliserParams(every=every * DT, retrace=RetraceParams(after=after)))
    lines = [np.linspace(a, b, int(20 * math.dist(a, b)) + 2) for a, b in corridor()]
    localiser.points, localiser.rng = np.concatenate(lines), np.random.default_rng(0)
    state, anchors, kept = None, [], []
    for here, there in zip(true, reckoned, strict=True):
        localiser.pose = tuple(here)
        rows = torch.zeros(2, 8) if localiser.due(state) else None
        state = localiser(rows, Pose(*(torch.tensor(v) for v in there)), state)
        anchors.append(anchor_of(state))
        kept.append(None if state.trail is None else len(state.trail.entries))
    return true, state, anchors, kept


def off(true, state, anchors):
    """How far the car was from where it is known at the end to have been, m."""
    frames = located_frames(state)
    where = dict(zip(frames.numbers.tolist(), frames.poses.numpy(), strict=True))
    moved = np.array([carried(where[a.frame], np.array(a.pose)) for a in anchors])
    return np.hypot(*(moved - true)[:, :2].T)


def test_what_was_seen_first_is_nearer_its_place():
    once, again = (off(*drive(after)[:3]) for after in ((), (25.0,)))
    early = slice(0, 100)  # 10 m
    assert np.median(again[early]) < 0.7 * np.median(once[early])
    assert np.median(again) < 0.7 * np.median(once)


@pytest.mark.parametrize("every", [1, 2, 3])
def test_it_catches_up_and_then_keeps_nothing_more(every):
    _, state, anchors, kept = drive((8.0, 14.0), every)
    assert kept[-1] is None
    assert state.trail is None
    last = next(n for n, count in enumerate(kept) if count is None)
    assert kept[last - 1] == -(-last // every)  # every scan up to there
    assert set(located_frames(state).numbers.tolist()) >= {anchor.frame for anchor in anchors}
    assert int(state.age) == len(kept)


def test_scans_of_a_car_that_stands_are_not_kept():
    stand = 30
    _, _, _, kept = drive((50.0,), steps=20, stand=stand)
    first = round(LocaliserParams().settle / DT)
    assert kept[stand - 1] == first
    assert kept[-1] == first + 20


def test_a_car_that_was_carried_goes_through_nothing_again():
    _, state, anchors, _ = drive((50.0,), steps=40)
    put = Localiser(StereoRig(), DT).put(state, Pose(*(torch.tensor(v) for v in (1.0, 2.0, 3.0))))
    assert put.trail is None
    numbers = located_frames(put).numbers.tolist()
    assert anchors[5].frame in numbers  # of a part that was finished


def test_what_cannot_be_is_said():
    for after in ((0.0,), (20.0, 10.0)):
        with pytest.raises(InputError, match="after"):
            RetraceParams(after=after)
    with pytest.raises(InputError, match="widen"):
        RetraceParams(widen=0.0)
