"""Features of rows and ranges of a ray-cast world, against plain loops and the geometry."""

import math
from functools import cache

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.navigation import DeadReckoning, FeatureParams, Grid, GridMap, MatchParams, Pose, StereoRanging, StereoRig
from ndtorch.navigation.stereo.features import (
    Features,
    PredictedFeatures,
    edge_places,
    find_features,
    match_features,
)
from tests.navigation import planar_world

RIG, DT = StereoRig(), 1 / 30

# Casting the rays takes longer than all that is measured with them.
hallway = cache(planar_world.hallway)


def path(curvature, steps):
    """Poses at 0.5 m/s."""
    pose, _ = DeadReckoning(DT)(
        torch.full((steps,), 0.5, dtype=torch.float64), torch.full((steps,), curvature, dtype=torch.float64)
    )
    return pose


@cache
def driven(world, curvature, steps):
    """Left and right rows, and the left eyes."""
    return world.drive(torch.stack(list(path(curvature, steps)), -1).numpy())


def measure(world, curvature=0.0, steps=300, noise=0.0, **options):
    """Drive at 0.5 m/s; estimated and true range of every match along the pixel it was seen in."""
    pose = path(curvature, steps)
    poses = torch.stack(list(pose), -1).numpy()
    left, right, eyes = driven(world, curvature, steps)
    rng = np.random.default_rng(0)
    left, right = (rows + noise * rng.standard_normal(rows.shape) for rows in (left, right))
    rows = (torch.tensor(side, dtype=torch.float32)[:, None, None] for side in (left, right))
    ranges, _ = StereoRanging(RIG, DT, **options)(*rows)
    valid = ranges.valid.numpy()
    angle = ranges.left_angle.double().numpy()
    if options.get("angles") == "linear":
        angle = np.arctan(angle / RIG.pixel_angle / RIG.focal)  # the pixel it was seen in
    true = np.stack([world.cast(eyes[t], poses[t, 2] + angle[t])[0] for t in range(steps)])
    return ranges.left_range.double().numpy()[valid], true[valid], ranges, pose


def figures(found, true):
    """Share within 25 %; bias and median error of those between 1 and 2.1 m."""
    error = found / true - 1
    good = np.abs(error) < 0.25
    near = error[good & (found >= 1.0) & (found <= 2.1)]
    assert len(near) > 50
    return good.mean(), near.mean(), np.median(np.abs(near))


@pytest.mark.parametrize(("half_width", "seed"), [(0.7, 5), (0.8, 2), (1.0, 0)])
def test_ranges_of_edges(half_width, seed):
    """Moved to the edges, features are ranged to a third of the error, and more of them find their partners."""
    edges = FeatureParams(edge_reach_px=4, shared=True)
    share, bias, median = figures(*measure(hallway(half_width, seed=seed), noise=0.003, features=edges)[:2])
    before, _, coarse = figures(*measure(hallway(half_width, seed=seed), noise=0.003)[:2])
    assert share >= 0.85
    assert share >= before
    assert abs(bias) < 0.005
    assert median < 0.003
    assert median < coarse / 2


def test_map_of_a_hallway():
    """A7: edges of the panels come out where they are; the strongest blobs lie within 2 cm of an edge."""
    world = hallway(1.0, length=8.0, panels=(0.3, 0.8))
    _, _, ranges, pose = measure(world, steps=360)
    grid = Grid(-1.0, 9.0, -2.0, 2.0)
    cells, _ = GridMap(RIG, grid)(ranges, Pose(*(part.float() for part in pose)))
    cells = GridMap.normalise(cells)
    edges = []
    for k in range(2):
        for place in world.edges[k]:
            edges.append(world.start[k] + place * world.along[k])
    edges = np.array(edges)
    # Peaks: cells that are the largest within 15 cm and of at least a fifth of the map's maximum.
    window = torch.nn.functional.max_pool2d(cells[None], 31, 1, 15)[0]
    row, column = torch.nonzero((cells == window) & (cells > 0.2), as_tuple=True)
    x, y = (part.numpy() for part in grid.center(row, column))
    distance = np.array([np.hypot(edges[:, 0] - a, edges[:, 1] - b).min() for a, b in zip(x, y, strict=True)])
    assert len(distance) >= 10
    assert np.median(distance) < 0.02
    assert (distance < 0.06).mean() > 0.8
    # Spacing of neighbouring peaks on one wall against that of the edges they belong to.
    left = np.sort(x[(y > 0.9) & (distance < 0.06)])
    true = np.sort(edges[edges[:, 1] > 0][:, 0])
    matched = np.array([true[np.abs(true - a).argmin()] for a in left])
    spacing, wanted = np.diff(left), np.diff(matched)
    apart = wanted > 0
    assert apart.sum() >= 4
    assert np.median(np.abs(spacing[apart] / wanted[apart] - 1)) < 0.03
    assert math.isclose(float(cells.max()), 1.0)


def rows(seed, *shape, scale=0.2):
    generator = torch.Generator().manual_seed(seed)
    row = torch.rand(*shape, generator=generator, dtype=torch.float64)
    motion = (torch.rand(*shape, generator=generator, dtype=torch.float64) - 0.5) * scale
    return row, motion


def plain_features(row, motion, p):
    """The paper's procedure, one pixel at a time."""
    free = [0 < n < len(row) - 1 for n in range(len(row))]
    picks = []
    for _ in range(p.count):
        best = max((n for n in range(len(row)) if free[n]), key=lambda n: abs(motion[n]), default=None)
        if best is None:
            break
        picks.append(best)
        for n in range(len(row)):
            if abs(n - best) <= p.spacing_px:
                free[n] = False

    def error(a, b):
        return sum((row[a + k] - row[b + k]) ** 2 for k in (-1, 0, 1))

    valid = [
        abs(motion[a]) >= p.min_motion and all(error(a, b) >= p.min_difference for b in picks if b != a) for a in picks
    ]
    return picks, valid


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(60, 90), st.integers(1, 6), st.integers(0, 4))
def test_against_plain_loops(seed, width, count, spacing):
    params = FeatureParams(count=count, spacing_px=spacing, min_motion=0.03, min_difference=0.05)
    row, motion = rows(seed, width)
    found = find_features(row, motion, params)
    picks, valid = plain_features(row.tolist(), motion.tolist(), params)
    assert found.column.tolist() == picks
    assert found.valid.tolist() == valid


def averaged_step(width, place, low, high):
    """A step at a fraction of a pixel as pixels average it."""
    share = (torch.arange(width, dtype=torch.float64) + 0.5 - place).clamp(0, 1)
    return low + (high - low) * share


@settings(max_examples=80, deadline=None)
@given(st.floats(8, 30), st.floats(0, 1), st.floats(0, 1), st.integers(-4, 4))
def test_edges_are_found_to_a_fraction_of_a_pixel(place, low, high, off):
    if abs(high - low) < 0.05:
        return
    row = averaged_step(40, place, low, high)
    found = edge_places(row, torch.tensor([round(place) + off]), reach=4)
    assert float(found) == pytest.approx(place, abs=1e-9)


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
