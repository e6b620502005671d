"""The rasteriser against rays cast one by one, and what cameras see of a plan."""

import math

import numpy as np
import pytest
import torch

from ndtorch.navigation import Rect, StereoRig
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.disturbances import Disturbances
from ndtorch_robot.sim.plan import Plan, ring
from ndtorch_robot.sim.simulation import RIG, Cameras, Simulation
from ndtorch_robot.sim.world import World, with_mipmaps


def between_texels(image, u, v):
    """The color between four texels; the picture goes on at its other side."""
    high, wide = image.shape[:2]
    x, y = u * wide - 0.5, v * high - 0.5
    left, top = math.floor(x), math.floor(y)
    along, down = x - left, y - top
    rows = [image[(top + k) % high].astype(float) for k in (0, 1)]
    (a, b), (c, d) = ([row[(left + k) % wide] for k in (0, 1)] for row in rows)
    return (a * (1 - along) + b * along) * (1 - down) + (c * (1 - along) + d * along) * down


def ray(camera, corners, column, row):
    """Distance along a ray, times the depth of its direction, and the place in the picture, for each triangle hit."""
    direction = np.linalg.solve(camera[1:], [column, row, 1.0])
    found = {}
    for n, triangle in enumerate(corners):
        a, b, c = triangle[:, :3]
        if np.cross(b - a, c - a) @ direction >= 0:  # seen from behind
            continue
        depth, p, q = np.linalg.solve(np.stack((direction, a - b, a - c), 1), a - camera[0])
        if p >= 0 and q >= 0 and p + q <= 1 and depth > 0.02:
            found[n] = (depth, triangle[:, 3:].T @ [1 - p - q, p, q])
    return found


def test_random_triangles_against_rays():
    """Where a pixel and its neighbours meet the same triangle, the color is what a ray finds, to a level of 256."""
    rng = np.random.default_rng(3)
    image = rng.integers(0, 256, (16, 24, 3), dtype=np.uint8)
    texels, mipmaps = with_mipmaps([image])
    levels = []
    for begin, wide, high in mipmaps[0, :5].tolist():
        inner = texels[begin : begin + (wide + 2) * (high + 2)].reshape(high + 2, wide + 2)[1:-1, 1:-1]
        levels.append(np.stack([inner >> 8 * c & 255 for c in range(3)], -1))
    corners = rng.normal(0, 1.5, (40, 3, 5))
    corners[:, :, 0] += 4.5
    surface = np.where(np.arange(40) % 4 == 0, -1 - 0x30A0F0, 0).astype(np.int32)
    nothing = np.zeros((0, 2, 2)), np.zeros((0, 3)), []
    rig = StereoRig(0.3, 90.0, 96, 60, forward=0.0)
    world = World(corners, surface, texels, mipmaps, *nothing)
    cameras = Cameras(world, rig, disturbances=Disturbances(pitch_deg=5, roll_deg=10))
    view = camera = cameras.view(0.1, -0.2, 0.2, 0)
    drawn, compared, background = cameras.frame(view).transpose(1, 2, 0).astype(float), 0, 0
    for row in range(2, 58, 6):
        for column in range(2, 94, 6):
            around = ((0, 0), (1, 0), (0, 1), (-1, 0), (0, -1))
            hits = [ray(camera, corners, column + dx, row + dy) for dx, dy in around]
            nearest = [min(hit, key=lambda n, hit=hit: hit[n][0]) if hit else -1 for hit in hits]
            if len(set(nearest)) > 1:
                continue
            n = nearest[0]
            if n < 0:
                background += 1
                assert not drawn[row, column].any()
                continue
            compared += 1
            if surface[n] < 0:
                assert drawn[row, column].tolist() == [0xF0, 0xA0, 0x30]
                continue
            (_, (u, v)), right, below = (hit[n] for hit in hits[:3])
            spans = [(place[1] - (u, v)) * (24, 16) for place in (right, below)]
            size = max(math.log2(max(math.hypot(*s) for s in spans)), 0.0)
            low = min(math.floor(size), len(levels) - 2)
            share = min(size - low, 1.0)
            near, far = between_texels(levels[low], u, v), between_texels(levels[low + 1], u, v)
            wanted = near * (1 - share) + far * share
            # The logarithm is taken straight from power to power, and of the pixel's middle.
            doubt = 2.0 + 0.25 * np.abs(between_texels(levels[max(low - 1, 0)], u, v) - far).max() * (size > 0)
            assert np.abs(drawn[row, column] - wanted).max() <= doubt
    assert compared > 40
    assert background > 3


def test_strips_of_a_frame_are_the_frame():
    """Strips and slices of them are the pixels of the whole frame, to the bit."""
    cameras = Simulation(load_arena("office", 3), 3, full_frames=True).cameras
    view = cameras.view(1.0, 0.3, 0.4, 1)
    whole = cameras.frame(view)
    assert whole.std() > 10
    for top, bottom, left, right in ((0, 480, 3, 4), (301, 330, 11, 640), (240, 241, 0, 640)):
        rect = Rect(top, bottom, left, right)
        assert np.array_equal(cameras.render([view], [[rect]])[0], whole[:, top:bottom, left:right])


def test_axes_of_turned_cameras():
    def axes(heading, side, **errors):
        _, _, down, ahead = Cameras(None, RIG, disturbances=Disturbances(**errors)).view(0.0, 0.0, heading, side)
        return ahead, (RIG.center[1] * ahead - down) / RIG.focal

    assert np.array(axes(0.3, 0)) == pytest.approx(np.array([[math.cos(0.3), math.sin(0.3), 0], [0, 0, 1]]))
    down, up = axes(0.0, 1, pitch_deg=3)
    assert down == pytest.approx([math.cos(math.radians(3)), 0, -math.sin(math.radians(3))])
    assert up[0] == pytest.approx(math.sin(math.radians(3)))
    assert axes(0.0, 0, roll_deg=2)[1] == pytest.approx([0, -math.sin(math.radians(2)), math.cos(math.radians(2))])
    yaws = [math.degrees(math.atan2(*axes(0.0, side, yaw_deg=1, right_yaw_deg=2)[0][1::-1])) for side in (0, 1)]
    assert yaws == pytest.approx([1, 3])


def test_edges_are_where_the_rig_says():
    """A dark pillar before blank walls: both its sides in the horizon rows of both cameras."""
    square = ring([(0, -3), (6, -3), (6, 3), (0, 3)], "blank")
    pillar = ring([(2.5, -0.2), (2.9, -0.2), (2.9, 0.2), (2.5, 0.2)], "pillar", solid=True)
    simulation = Simulation(Plan("test", square, (pillar,), (1.0, 0.0, 0.0)))
    for eye, side in zip(simulation.cameras.look(1.0, 0.0, 0.0), (0.15, -0.15), strict=True):
        row = eye.row[0, :, 0].float().mean(0)
        jumps = torch.nonzero((row[1:] - row[:-1]).abs() > 30).flatten() + 0.5
        depth = torch.tensor(2.5 - 1.0 - RIG.forward)
        wanted = [float(RIG.project(depth, torch.tensor(y - side), 0.0)[0]) for y in (0.2, -0.2)]
        assert jumps.tolist() == pytest.approx(wanted, abs=1.0)
        # The subfields see floor only.
        assert 0.03 < float(eye.field.float().std()) / 255 * 2 < 0.2


def test_cameras_that_are_mounted_pitched_see_what_those_see_that_have_slipped():
    seen = []
    for pitch, slipped in ((math.radians(5), 0.0), (0.0, 5.0)):
        rig = StereoRig(pitch=pitch, forward=0.15)
        disturbances = Disturbances(pitch_deg=slipped)
        simulation = Simulation(load_arena("room"), 3, rig=rig, disturbances=disturbances, full_frames=True)
        seen.append(simulation.read().left)
    assert torch.equal(*seen)
