"""The rasteriser: against rays cast one by one, and against MuJoCo's own renderer."""

import math

import mujoco
import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Rect
from ndtorch_robot.sim import cameras
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.cameras import Motion, axes
from ndtorch_robot.sim.disturbances import read_disturbances
from ndtorch_robot.sim.disturbances.registry import CameraErrors
from ndtorch_robot.sim.render._kernels import rasterise
from ndtorch_robot.sim.render._kernels_textures import build_mipmaps
from ndtorch_robot.sim.render.renderers import Lens, OpenGLRenderer, View, projection
from ndtorch_robot.sim.render.scene import is_supported
from ndtorch_robot.sim.simulation import Simulation

LENS = Lens(90.0, (47.5, 29.5), 96, 60)


def smaller(image):
    """An image of half the size: means of two by two, rounded as eight bits are, first along rows."""

    def axis(many):
        few = max(many // 2, 1)
        place = (np.arange(few) + 0.5) * many / few - 0.5
        low = np.floor(place).astype(int)
        return np.maximum(low, 0), np.minimum(low + 1, many - 1), np.floor((place - low) * 256 + 0.5) / 256

    (top, bottom, down), (left, right, along) = map(axis, image.shape[:2])
    wide = np.floor(image[:, left] * (1 - along)[:, None] + image[:, right] * along[:, None] + 0.5)
    return np.floor(wide[top] * (1 - down)[:, None, None] + wide[bottom] * down[:, None, None] + 0.5)


def copies_of(image):
    copies = [image.astype(float)]
    while max(copies[-1].shape[:2]) > 1:
        copies.append(smaller(copies[-1]))
    return copies


def packed(image, levels):
    """Texels of an image and its smaller copies, and where each begins, its width and its height."""
    copies, start = np.zeros((8, 3), np.int32), 0
    for k, copy in enumerate(levels):
        copies[k] = (start, copy.shape[1], copy.shape[0])
        start += (copy.shape[0] + 2) * (copy.shape[1] + 2)
    texels = np.zeros(start, np.uint32)
    build_mipmaps(image.reshape(-1), copies, texels)
    return texels, copies


@pytest.mark.parametrize("size", [(16, 16), (13, 22), (1, 5)])
def test_mipmaps(size):
    image = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    wanted = copies_of(image)
    texels, copies = packed(image, wanted)
    for (start, wide, high), copy in zip(copies.tolist(), wanted, strict=False):
        got = texels[start : start + (wide + 2) * (high + 2)].reshape(high + 2, wide + 2)
        bordered = np.pad(copy, ((1, 1), (1, 1), (0, 0)), "wrap")
        assert np.array_equal(np.stack([got >> 8 * c & 255 for c in range(3)], -1), bordered)


def looked_up(copy, u, v):
    """The color between four texels; the picture goes on at its other side."""
    high, wide = copy.shape[:2]
    x, y = u * wide - 0.5, v * high - 0.5
    left, top = math.floor(x), math.floor(y)
    along, down = x - left, y - top
    rows = [copy[(top + k) % high] for k in (0, 1)]
    (a, b), (c, d) = ([row[(left + k) % wide] for k in (0, 1)] for row in rows)
    return (a * (1 - along) + b * along) * (1 - down) + (c * (1 - along) + d * along) * down


def ray(camera, corners, column, row):
    """Distance along a ray, times the depth of its direction, and the place in the picture, for each triangle hit."""
    matrix = np.array(camera[1:])
    direction = np.linalg.solve(matrix, [column, row, 1.0])
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
    levels = copies_of(image)
    texels, copies = packed(image, levels)
    corners = rng.normal(0, 1.5, (40, 3, 5))
    corners[:, :, 0] += 4.5
    surface = np.where(np.arange(40) % 4 == 0, -1 - 0x30A0F0, 0).astype(np.int32)
    view = View((0.1, -0.2, 0.3), *axes(0.2, 0, CameraErrors(pitch=math.radians(5), roll=math.radians(10))))
    camera = projection(view, LENS)
    out = np.zeros((60 * 96, 3), np.uint8)
    parts = np.array([[0, 0, 60, 0, 96, 0]])
    rasterise(corners, surface, texels, copies[None], np.array([camera]), parts, (0.02, 60.0), out)
    drawn, compared, background = out.reshape(60, 96, 3).astype(float), 0, 0
    for row in range(2, 58, 6):
        for column in range(2, 94, 6):
            hits = [
                ray(camera, corners, column + dx, row + dy) for dx, dy in ((0, 0), (1, 0), (0, 1), (-1, 0), (0, -1))
            ]
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
            near, far = looked_up(levels[low], u, v), looked_up(levels[low + 1], u, v)
            wanted = near * (1 - share) + far * share
            # The logarithm is taken straight from power to power, and of the pixel's middle.
            doubt = 2.0 + 0.25 * np.abs(looked_up(levels[max(low - 1, 0)], u, v) - far).max() * (size > 0)
            assert np.abs(drawn[row, column] - wanted).max() <= doubt
    assert compared > 40
    assert background > 3


def test_strips_of_a_frame_are_the_frame():
    """Strips and slices of them are the pixels of the whole frame, to the bit."""
    simulation = Simulation(load_arena("office", 3), 3, full_frames=True, pedestrian=True)
    renderer = simulation.cameras.renderer
    simulation.cameras.look(simulation.data, 1.0, 0.3, 0.4)
    view = simulation.cameras.view(1.0, 0.3, 0.4, 1)
    whole = renderer.frame(view)
    assert whole.std() > 10
    for top, bottom, left, right in ((0, 480, 3, 4), (301, 330, 11, 640), (240, 241, 0, 640)):
        rect = Rect(top, bottom, left, right)
        halves = [Rect(top, (top + bottom) // 2, left, right), Rect((top + bottom) // 2, bottom, left, right)]
        one, two = renderer.strips([[(view, rect)], [(view, half) for half in halves if half.bottom > half.top]])
        assert np.array_equal(one, whole[:, top:bottom, left:right])
        assert np.array_equal(one, two)


CASES = [
    ("hallway", "", False),
    ("office", "roll_deg=3,pitch_deg=3", True),
    ("room", "rolling,blur,focal,yaw,right-yaw,baseline", True),
]


@pytest.mark.parametrize(("arena", "disturbance", "pedestrian"), CASES)
def test_the_rasteriser_draws_what_mujoco_draws(arena, disturbance, pedestrian, monkeypatch):
    """At most one level of 256 off, but for fewer than one color in five hundred at the edges of objects."""
    wide = (Rect(302, 372, 80, 640), Rect(302, 372, 0, 560))
    options = {"pedestrian": pedestrian, "disturbances": read_disturbances(disturbance), "fields": wide}
    ours = Simulation(load_arena(arena, 7), 7, **options)
    monkeypatch.setattr(cameras, "make_renderer", OpenGLRenderer)
    try:
        theirs = Simulation(load_arena(arena, 7), 7, **options)
    except InputError as error:
        pytest.skip(str(error))
    assert isinstance(theirs.cameras.renderer, OpenGLRenderer)
    rng, off = np.random.default_rng(1), []
    for _ in range(4):
        x, y, heading = ours.spawn_points.random(rng)
        seen = [one.cameras.look(one.data, x, y, heading, Motion(0.5, 0.3)) for one in (ours, theirs)]
        for one, other in zip(*seen, strict=True):
            off += [(a.int() - b.int()).abs().flatten() for a, b in zip(one, other, strict=True)]
    apart = torch.cat(off)
    assert float((apart > 1).float().mean()) < 0.002
    assert float(apart.float().mean()) < 0.1
    theirs.close()


def test_other_shapes_are_left_to_mujoco(monkeypatch):
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[1, 1, 1])
    assert is_supported(spec.compile())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[1, 0, 0])
    model = spec.compile()
    assert not is_supported(model)
    clear = mujoco.MjSpec()
    clear.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[1, 1, 1], rgba=[1, 1, 1, 0.5])
    assert not is_supported(clear.compile())

    def broken(*given):
        raise RuntimeError("no display")

    monkeypatch.setattr(mujoco, "Renderer", broken)
    with pytest.raises(InputError, match=r"needs OpenGL.*no display.*set MUJOCO_GL=egl"):
        OpenGLRenderer(model, LENS)
