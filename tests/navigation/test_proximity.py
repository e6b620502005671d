"""What is right before a car that stands: walls and floor drawn by rays."""

import math

import numpy as np
import pytest
import torch

from ndtorch.navigation import Command, Navigator, StereoRig
from ndtorch.navigation.proximity import HALF_WIDTH_M, MIN_CORRELATION, Obstacles, ProximityCheck, correlation
from ndtorch.navigation.stereo.strips import as_frames

RIG = StereoRig(forward=0.15)
DT = 1 / 30
RECTS = Navigator(RIG, DT).controller.fields
CHECK = ProximityCheck(RIG, RECTS)


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
    obstacles = CHECK.obstacles(as_frames(left[0], right[0]))
    return obstacles, correlation(*fields((left, right)), CHECK.corners, CHECK.spans, CHECK.least, MIN_CORRELATION)


@pytest.mark.parametrize("wall", [0.35, 0.5, 0.8])
def test_a_wall_is_near_and_no_floor(wall):
    things, likeness = looked(*pair(wall))
    assert len(things.x) > 5
    assert np.abs(things.x - RIG.forward - wall).max() < 0.06 * wall
    assert np.abs(things.y).max() <= HALF_WIDTH_M
    assert likeness < 0.7


def test_floor_is_floor():
    for frames in (pair(3.0), pair(3.0, turned_down=math.radians(2))):
        things, likeness = looked(*frames)
        assert len(things.x) == 0
        assert likeness > 0.7
    assert looked(*pair(3.0, floor=0.0))[1] == 0.0  # without texture nobody can say
    things, likeness = looked(*pair(0.4, paint=0.0))  # nor of a blank wall
    assert len(things.x) == 0
    assert likeness == 0.0


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


def fields(frames):
    eyes = zip(frames, RECTS, strict=True)
    return np.stack([eye[0, 0, r.top : r.bottom, r.left : r.right].numpy() / np.float32(255) for eye, r in eyes])


OPEN, SHUT = fields(pair(3.0)), fields(pair(0.9))


def left_of(depth, y, seen=OPEN, count=6):
    x = np.full(count, RIG.forward + depth, np.float32)
    near = Obstacles(x, (y + 0.002 * np.arange(count)).astype(np.float32))
    return len(CHECK.on_floor(near, seen).x)


@pytest.mark.parametrize(("depth", "y"), [(0.35, 0.0), (0.45, -0.1), (0.45, 0.2), (0.7, 0.1), (0.88, -0.14)])
def test_what_would_hide_the_floor_that_is_seen_is_not_there(depth, y):
    assert left_of(depth, y) == 0
    assert left_of(depth, y, count=1) == 0
    assert left_of(depth, y, SHUT) == 6  # what stands there hides it
    assert left_of(depth, y, count=12) == 12  # what hangs hides none
