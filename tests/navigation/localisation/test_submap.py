"""A car drives rounds of a corridor with a wrong odometer: submaps are moved until the walls are right."""

import math

import numpy as np
import pytest

from ndtorch.navigation import StereoRig
from ndtorch.navigation.localisation.ndt import Scan, add_scan, distributions, empty_map
from ndtorch.navigation.localisation.pose_graph import compose_poses
from ndtorch.navigation.localisation.state import map_frames
from ndtorch.navigation.localisation.submap import add_to_submap, empty_graph, render_map
from tests.navigation.localisation.worlds import DT, PARAMS, PointLocaliser, corridor, path, rounds, sampled

POINTS = sampled(corridor())


def run(true, reckoned, params=PARAMS, state=None):
    """Poses, poses in frames and the last state of a drive."""
    found, frames, states = PointLocaliser(StereoRig(), DT, POINTS, params, count=14).drive(true, reckoned, state)
    return found, frames, states[-1]


def off_walls(state):
    """Distances of the means of the cells from the nearest wall, m."""
    mean = distributions(state.ndt_map, PARAMS.cell_m)[0]
    a, b = corridor().transpose(1, 0, 2)
    share = ((mean[:, None] - a) * (b - a)).sum(-1) / ((b - a) ** 2).sum(-1)
    nearest = a + np.clip(share, 0, 1)[..., None] * (b - a)
    return np.hypot(*(mean[:, None] - nearest).transpose(2, 0, 1)).min(1)


def test_after_three_rounds_with_a_wrong_odometer_the_walls_are_right():
    driven = rounds(3)
    true, reckoned = path(driven), path(driven, 0.03, 0.03, math.radians(0.1) * DT)
    assert math.dist(true[-1, :2], reckoned[-1, :2]) > 0.7
    found, frames, state = run(true, reckoned)
    off = found - true
    last = off[-len(off) // 3 :]
    # Black rows give no visual odometry. While a round is matched, the pose may jump.
    assert np.hypot(*last[:, :2].T).max() < 0.2
    assert np.abs(last[:, 2]).max() < math.radians(3)
    aside = off_walls(state)
    assert np.median(aside) < 0.02
    assert np.percentile(aside, 90) < 0.08
    assert state.calibration[0] == pytest.approx(0.03 / 1.03, abs=0.01)
    # Frames move with their submaps, merged ones too.
    now = map_frames(state)
    where = dict(zip(now.numbers.tolist(), now.poses.numpy(), strict=True))
    moved = np.array([compose_poses(where[at.frame], np.array(at.pose)) for at in frames])
    assert len(state.graph.merged_submaps) > 0
    as_driven, afterwards = (np.percentile(np.hypot(*(poses - true)[:, :2].T), 90) for poses in (found, moved))
    assert afterwards < 0.7 * as_driven


def test_a_state_is_not_changed_and_goes_on_the_same():
    driven = rounds(1)
    true, reckoned = path(driven), path(driven, 0.02)
    *_, kept = run(true[:60], reckoned[:60])
    before, count = kept.ndt_map.copy(), len(kept.graph.submaps)
    ends = [run(true[60:], reckoned[60:], state=kept)[-1] for _ in range(2)]
    assert np.array_equal(kept.ndt_map, before)
    assert np.array_equal(ends[0].pose, ends[1].pose)
    assert np.array_equal(ends[0].ndt_map, ends[1].ndt_map)
    assert np.array_equal(ends[0].graph.poses, ends[1].graph.poses)
    assert len(ends[0].graph.submaps) > count > 0


def test_a_submap_is_rendered_where_its_frame_is():
    rng, pose, size, cell = np.random.default_rng(3), np.array((1.3, -0.7, 0.6)), PARAMS.map_cells, PARAMS.cell_m
    scan = Scan(*rng.uniform(-2, 2, (2, 500)), np.ones(500))
    rendered = render_map(add_to_submap(empty_graph(pose, PARAMS), scan, pose, cell), DT, PARAMS)
    there = add_scan(empty_map(size), scan, pose, cell)
    at = (np.indices((size, size)).transpose(1, 2, 0) - size // 2 + 0.5) * cell
    for power in (1, 2):  # first and second moments of all points together are kept
        sums = []
        for cells in (rendered.astype(float), there.astype(float)):
            weight, mean = cells[..., :1], cells[..., 1:3]
            square = cells[..., [3, 5]] + 2 * at * mean + at**2 * weight
            sums.append((at * weight + mean if power == 1 else square).sum((0, 1)))
        assert sums[0] == pytest.approx(sums[1], rel=1e-3)
