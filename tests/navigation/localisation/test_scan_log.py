"""The scan log is replayed once the odometry is calibrated, which moves the first scans to where they were."""

import math

import numpy as np
import pytest

from ndtorch.navigation import StereoRig
from ndtorch.navigation.localisation import LocaliserParams, ReplayParams
from ndtorch.navigation.localisation.pose_graph import compose_poses
from ndtorch.navigation.localisation.state import map_frames
from tests.navigation.localisation.worlds import DT, PointLocaliser, corridor, path, rounds, sampled


def drive(after_m, every=1, steps=None, standing=0):
    """Rounds of a corridor with a wrong odometer: true poses, poses in frames, and the states."""
    driven = rounds(2)[:steps]
    true, reckoned = path(driven), path(driven, 0.05, 0.03, math.radians(0.1) * DT)
    true, reckoned = (np.concatenate((poses[:1].repeat(standing, 0), poses)) for poses in (true, reckoned))
    params = LocaliserParams(scan_interval_s=every * DT, replay=ReplayParams(after_m=after_m))
    localiser = PointLocaliser(StereoRig(), DT, sampled(corridor()), params, count=14)
    _, frames, states = localiser.drive(true, reckoned)
    return true, frames, states


def off(true, frames, states):
    """Distances of the true poses from where they are known to have been in the end, m."""
    now = map_frames(states[-1])
    where = dict(zip(now.numbers.tolist(), now.poses.numpy(), strict=True))
    moved = np.array([compose_poses(where[at.frame], np.array(at.pose)) for at in frames])
    return np.hypot(*(moved - true)[:, :2].T)


def test_the_first_scans_are_nearer_their_place_after_a_replay():
    once, again = (off(*drive(after_m)) for after_m in ((), (25.0,)))
    early = slice(0, 100)  # 10 m
    assert np.median(again[early]) < 0.7 * np.median(once[early])
    assert np.median(again) < 0.7 * np.median(once)


@pytest.mark.parametrize("every", [1, 2, 3])
def test_a_replay_catches_up_and_the_log_ends_with_the_last(every):
    _, frames, states = drive((8.0, 14.0), every)
    logged = [None if state.log is None else len(state.log.entries) for state in states]
    assert logged[-1] is None
    last = logged.index(None)
    assert logged[last - 1] == -(-last // every)  # every scan up to there
    assert set(map_frames(states[-1]).numbers.tolist()) >= {at.frame for at in frames}
    assert states[-1].age == len(states)
