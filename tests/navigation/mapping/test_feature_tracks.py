"""Tracks: what moves is flagged, what stands still is not, whatever the car does."""

import pytest
import torch

from ndtorch.navigation import AlphaBetaTracker, DeadReckoning, Pose, Ranges
from ndtorch.navigation.mapping.feature_tracks import FeatureTrackParams
from tests.navigation.planar_world import to_body

DT = 1 / 30


def seen(points, pose, noise=0.0, seed=0):
    """Ranges of world points `[T, n, 2]` from poses `[T]`, with range noise along the line of sight."""
    x, y = to_body(Pose(*(part.unsqueeze(-1) for part in pose)), *points.unbind(-1))
    generator = torch.Generator().manual_seed(seed)
    stretch = 1 + noise * torch.randn(x.shape, generator=generator)
    x, y = x * stretch, y * stretch
    return Ranges(torch.hypot(x, y), x * 0, x * 0, x, y, torch.ones_like(x, dtype=torch.bool))


def walk(starts, velocities, steps):
    time = torch.arange(steps).reshape(-1, 1, 1) * DT
    return torch.tensor(starts) + torch.tensor(velocities) * time


STILL = [[2.0, 0.8], [2.5, -0.7], [1.6, 0.0]]


@pytest.mark.parametrize("curvature", [0.0, 1.0, -0.5])
def test_moving_car_in_a_static_world(curvature):
    """The image of everything moves, yet no track is dynamic, at 2 % of range noise."""
    steps = 90
    pose, _ = DeadReckoning(DT)(torch.full((steps,), 0.5), torch.full((steps,), curvature))
    points = walk(STILL, [[0.0, 0.0]] * 3, steps)
    state = None
    for t in range(steps):
        now = slice(t, t + 1)
        tracks, state = AlphaBetaTracker(DT)(
            Ranges(*(p[now] for p in seen(points, pose, noise=0.02))), Pose(*(p[now] for p in pose)), state
        )
        assert not tracks.dynamic.any()
    assert int((state.unseen == 0).sum()) == 3


def test_a_walker_is_flagged_and_predicted():
    steps = 90
    pose, _ = DeadReckoning(DT)(torch.full((steps,), 0.5), torch.zeros(steps))
    points = walk([*STILL, [3.0, -0.8]], [[0.0, 0.0]] * 3 + [[-0.1, 0.6]], steps)
    tracks, _ = AlphaBetaTracker(DT)(seen(points, pose, noise=0.01), pose)
    assert int(tracks.dynamic.sum()) == 1
    k = int(tracks.dynamic.nonzero())
    assert tracks.velocity[k].tolist() == pytest.approx([-0.1, 0.6], abs=0.15)
    assert tracks.place[k].tolist() == pytest.approx(points[-1, 3].tolist(), abs=0.06)


def test_tracks_end_and_slots_are_reused():
    pose = Pose(*torch.zeros(3, 60))
    ranges = seen(walk([[1.0, 0.0]], [[0.0, 0.0]], 60), pose)
    gone = ranges._replace(valid=ranges.valid & (torch.arange(60) < 20).unsqueeze(-1))
    tracker = AlphaBetaTracker(DT, FeatureTrackParams(slots=2, max_lost_s=0.5))
    tracks, state = tracker(gone, pose)
    assert torch.isinf(tracks.unseen).all()
    tracks, _ = tracker(seen(walk([[2.0, 0.5]], [[0.0, 0.0]], 60), pose), pose, state)
    k = int(tracks.unseen.argmin())
    assert tracks.place[k].tolist() == pytest.approx([2.0, 0.5], abs=1e-4)
    assert float(tracks.age[k]) == pytest.approx(59 * DT, rel=1e-4)
