"""What is right before a car that stands: walls and floor drawn by rays."""

import math

import numpy as np
import pytest
import torch

from ndtorch.navigation import Command, Navigator, Ranges, StereoRig
from ndtorch.navigation.proximity import floor_consistency
from ndtorch.navigation.proximity._kernels import NEIGHBOURS, NO_MATCH, match_rows
from ndtorch.navigation.proximity.check import ProximityCheck
from ndtorch.navigation.proximity.floor_consistency import floor_correlation, reject_unoccluded
from ndtorch.navigation.proximity.params import ProximityParams
from ndtorch.navigation.proximity.stereo_match import Obstacles, detect_obstacles
from ndtorch.navigation.stereo.rig import Rect

RIG = StereoRig(forward=0.15)
DT = 1 / 30
NOWHERE = Ranges(*np.zeros((5, 1), np.float32), np.zeros(1, bool))


def texture(u, v, seed, contrast):
    """Smooth noise on a plane, 8 mm fine, `[...]` about 0.5."""
    cells = np.random.default_rng(seed).uniform(-1, 1, (1024, 1024))
    a, b = u / 0.008, v / 0.008
    i, j = np.floor(a).astype(int), np.floor(b).astype(int)
    s, t = a - i, b - j
    corners = [cells[(i + di) % 1024, (j + dj) % 1024] for di in (0, 1) for dj in (0, 1)]
    mixed = (corners[0] * (1 - t) + corners[1] * t) * (1 - s) + (corners[2] * (1 - t) + corners[3] * t) * s
    return 0.5 + contrast * mixed


def pair(wall, floor=0.15, paint=0.15, turned_down=0.0):
    """Frames `[1, 1, 480, 640]` of both cameras before a wall so many metres from them, on a floor."""
    rows, columns = np.mgrid[0:480, 0:640]
    across = (319.5 - columns) / RIG.focal
    down = (rows - 239.5) / RIG.focal + math.tan(turned_down)
    frames = []
    for side in (0.15, -0.15):
        depth = np.where(down > 0, RIG.camera_height / np.maximum(down, 1e-6), np.inf)
        on_floor = depth < wall
        y = side + np.minimum(depth, wall) * across
        height = -wall * down
        seen = np.where(on_floor, texture(np.minimum(depth, 9), y, 1, floor), texture(height, y, 2, paint))
        frames.append(torch.from_numpy((255 * seen[None, None]).round().astype(np.uint8)))
    return frames


def looked(left, right):
    rects = Navigator(RIG, DT).controller.fields
    fields = [
        eye[0, 0, r.top : r.bottom, r.left : r.right].numpy() / np.float32(255)
        for eye, r in zip((left, right), rects, strict=True)
    ]
    rows = [eye[0, 0, RIG.row].numpy() / np.float32(255) for eye in (left, right)]
    return (detect_obstacles(*rows, RIG, ProximityParams()), floor_correlation(*fields, rects, RIG, ProximityParams()))


@pytest.mark.parametrize("wall", [0.35, 0.5, 0.8])
def test_a_wall_is_near_and_no_floor(wall):
    things, likeness = looked(*pair(wall))
    assert len(things.x) > 5
    assert np.abs(things.x - RIG.forward - wall).max() < 0.06 * wall
    assert np.abs(things.y).max() <= ProximityParams().half_width_m
    assert likeness < ProximityParams().min_floor_correlation


def test_floor_is_floor():
    for frames in (pair(3.0), pair(3.0, turned_down=math.radians(2))):
        things, likeness = looked(*frames)
        assert len(things.x) == 0
        assert likeness > 0.7
    assert looked(*pair(3.0, floor=0.0))[1] == 0.0  # without texture nobody can say
    things, likeness = looked(*pair(0.4, paint=0.0))  # nor of a blank wall
    assert len(things.x) == 0
    assert likeness == 0.0


def match_plainly(left, right, first, high, half):
    """`match_rows` with all costs in one array, `[disparities, W]`."""
    width, size, depth = len(left), 2 * half + 1, high - first
    cost = np.full((depth, width), NO_MATCH)
    for d in range(first, high):
        windows = np.lib.stride_tricks.sliding_window_view(np.abs(left[d:] - right[: width - d]), size).mean(-1)
        cost[d - first, d + half : d + half + len(windows)] = windows
    best, columns, disparities = cost.argmin(0), np.arange(width), np.arange(depth)[:, None]
    partner = np.clip(columns - best - first, 0, width - 1)
    places = partner + first + disparities
    from_right = np.where(places < width, cost[disparities, np.minimum(places, width - 1)], NO_MATCH)
    elsewhere = np.where(np.abs(disparities - best) > NEIGHBOURS, cost, NO_MATCH).min(0)
    return best, from_right.argmin(0), cost[best, columns], elsewhere


@pytest.mark.parametrize("high", [43, 20])
def test_rows_are_matched_as_by_plain_sums(high):
    """In a narrow row, in which no window of the largest disparities fits."""
    chance = np.random.default_rng(3)
    left, right = (chance.random(60, dtype=np.float32) for _ in range(2))
    for ours, wanted in zip(match_rows(left, right, 1, high, 8), match_plainly(left, right, 1, high, 8), strict=True):
        np.testing.assert_allclose(ours, wanted, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("wall", "begins"), [(3.0, True), (0.5, False)])
def test_a_car_begins_only_where_floor_is_seen(wall, begins):
    navigator, (left, right) = Navigator(RIG, DT, near_check=True), pair(wall)
    state = None
    with torch.inference_mode():
        for _ in range(6):
            command, state = navigator(left, right, state, Command(torch.zeros(1), torch.zeros(1)))
    assert (float(command.speed) > 0) == begins
    trouble = navigator.controller.status_message(state.control)
    assert (trouble is None) == begins
    assert begins or "it cannot begin" in trouble
    if not begins:  # what was in the way is taken away
        left, right = pair(3.0)
        with torch.inference_mode():
            speeds = [navigator(left, right, state)]
            for _ in range(60):
                speeds.append(navigator(left, right, speeds[-1][1], Command(torch.zeros(1), torch.zeros(1))))
        assert float(speeds[0][0].speed) == 0


def correlate_plainly(left, right, rows, tilt, horizon, rects, rig, half_width):
    """Correlation of pixels that see one place of the floor, pair by pair."""
    ours, theirs = rects
    pairs = {}
    for row in rows:
        shift = round(rig.baseline / rig.camera_height * (row - horizon + tilt))
        for column in range(ours.left, ours.right):
            partner, ahead = column - shift, (rig.width - 1) / 2 - column + shift / 2
            if theirs.left <= partner < theirs.right and abs(ahead) * rig.baseline <= half_width * shift:
                both = left[row - ours.top, column - ours.left], right[row - theirs.top, partner - theirs.left]
                pairs.setdefault(row, []).append(both)
    kept = [np.array(each, float) for each in pairs.values() if len(each) >= 3]
    a, b = np.concatenate([each - each.mean(0) for each in kept]).T
    return float(a @ b / math.sqrt((a @ a) * (b @ b)))


@pytest.mark.parametrize("tilt", [0, 4])
def test_the_correlation_of_the_floor_against_plain_loops(tilt, monkeypatch):
    """With subfields so narrow that partners lie in their first and last columns."""
    monkeypatch.setattr(floor_consistency, "MIN_PIXELS", 40)
    monkeypatch.setattr(floor_consistency, "MIN_COLUMNS", 3)
    rig = StereoRig(width=120, height=80, focal=80.0)
    rects = Rect(50, 70, 20, 60), Rect(50, 70, 3, 33)
    rng = np.random.default_rng(4)
    left, right = (rng.random((20, r.right - r.left), np.float32) for r in rects)
    horizon, tilts = (rig.height - 1) / 2, [0, *range(-tilt, tilt + 1, 2)]
    depths = rig.focal * rig.camera_height / (np.array((69, 51)) - horizon)
    params = ProximityParams(
        floor_half_width_m=0.4,
        floor_min_depth_m=depths[0] - 1e-6,
        floor_max_depth_m=depths[1] + 1e-6,
        max_tilt_px=tilt,
        min_floor_correlation=1.0,
    )
    rows = np.arange(51, 70, 2)
    wanted = [correlate_plainly(left, right, rows, each, horizon, rects, rig, 0.4) for each in tilts]
    assert max(wanted) > 1e-3
    assert floor_correlation(left, right, rects, rig, params) == pytest.approx(max(wanted), abs=1e-5)


RECTS = Navigator(RIG, DT).controller.fields


def fields(frames):
    return [
        eye[0, 0, r.top : r.bottom, r.left : r.right].numpy() / np.float32(255)
        for eye, r in zip(frames, RECTS, strict=True)
    ]


OPEN, SHUT = fields(pair(3.0)), fields(pair(0.9))


def left_of(depth, y, seen=OPEN, count=6):
    x = np.full(count, RIG.forward + depth, np.float32)
    near = Obstacles(x, (y + 0.002 * np.arange(count)).astype(np.float32))
    return len(reject_unoccluded(near, *seen, RECTS, RIG, ProximityParams()).x)


@pytest.mark.parametrize(("depth", "y"), [(0.35, 0.0), (0.45, -0.1), (0.45, 0.2), (0.7, 0.1), (0.88, -0.14)])
def test_what_would_hide_the_floor_that_is_seen_is_not_there(depth, y):
    assert left_of(depth, y) == 0
    assert left_of(depth, y, count=1) == 0
    assert left_of(depth, y, SHUT) == 6  # what stands there hides it
    assert left_of(depth, y, count=12) == 12  # what hangs hides none


def ranged(depth, y, count=1):
    return Obstacles(np.full(count, RIG.forward + depth, np.float32), y + 0.2 * np.arange(count, dtype=np.float32))


@pytest.mark.parametrize(
    ("wall", "ranges", "count"),
    [
        (3.0, ranged(0.7, 0.0), 1),
        (3.0, ranged(0.45, -0.1), 1),
        (3.0, ranged(0.7, -0.1, 2), 0),  # two agree
        (3.0, ranged(2.0, 0.0), 0),
        (0.9, ranged(0.7, 0.0), 0),  # no floor is seen
    ],
)
def test_one_near_range_behind_which_floor_is_seen_is_a_mismatch(wall, ranges, count):
    left, right = (eye[0] for eye in pair(wall))
    check = ProximityCheck(RIG, RECTS)
    assert len(check((left, right), (left, right), ranges).mismatches.x) == count


@pytest.mark.parametrize("count", [1, 2])
def test_a_mismatch_does_not_hold_a_car_that_would_begin(monkeypatch, count):
    """The same false ranges in every frame, before open floor."""
    navigator, (left, right) = Navigator(RIG, DT), pair(3.0)
    false, ranging = ranged(0.7, -0.1, count), navigator.range

    def ranged_falsely(*given):
        ranges, filters = ranging(*given)
        x, y, valid = ranges.x.copy(), ranges.y.copy(), np.arange(len(ranges.x)) < count
        x[:count], y[:count] = false
        return ranges._replace(x=x, y=y, valid=valid), filters

    monkeypatch.setattr(navigator, "range", ranged_falsely)
    state, still = None, Command(torch.zeros(1), torch.zeros(1))
    with torch.inference_mode():
        for _ in range(8):
            command, state = navigator(left, right, state, still)
    assert (float(command.speed) > 0) == (count == 1)


def test_one_thing_that_cannot_be_takes_no_other_with_it():
    """Floor is open behind the first, and broken behind the second."""
    x = RIG.forward + np.repeat(np.float32([0.45, 0.7]), 5)
    near, (left, right) = Obstacles(x, np.repeat(np.float32([-0.1, 0.1]), 5)), OPEN
    middle = left.shape[1] // 2
    broken = np.where(np.arange(left.shape[1]) < middle, SHUT[0], left)
    kept = reject_unoccluded(near, broken, right, RECTS, RIG, ProximityParams())
    assert np.allclose(kept.x, RIG.forward + 0.7)


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_floor_is_compared_from_the_first_to_the_last_column_of_a_thing_and_no_further(mirrored):
    """Eleven places, 7 columns apart: floor of which the outer half is broken hides behind them, floor broken beside
    them does not."""
    depth, column = 0.45, 440 + 7 * np.arange(11)
    aside = RIG.baseline / 2 - (column - RIG.center[0]) * depth / RIG.focal
    near = Obstacles(np.full(11, RIG.forward + depth, np.float32), aside.astype(np.float32))
    for broken, kept in ((column < 475, 11), (np.zeros(11, bool), 0)):
        at = np.arange(RECTS[0].left, RECTS[0].right)
        outside = (at < column[0] - 10) | (at > column[-1] + 10)
        inside = np.isin(at, column[broken ^ mirrored][:, None] + np.arange(-9, 4)) if broken.any() else outside
        left, right = OPEN[0].copy(), OPEN[1]
        left[:, inside] = np.random.default_rng(0).uniform(0, 1, left[:, inside].shape)
        assert len(reject_unoccluded(near, left, right, RECTS, RIG, ProximityParams()).x) == kept
