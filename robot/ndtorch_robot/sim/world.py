"""A building as the rasteriser draws it and the car bumps into it: triangles, textures, walls and posts."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from ndtorch.navigation import Body, StereoRig
from ndtorch_robot.sim.plan import Floats, Plan, Point
from ndtorch_robot.sim.textures import Image, ceiling_texture, floor_texture, ring_textures

SKIRTING = (0.006, 0.08)
"""Depth and height of the skirting, m."""

GROUND_CLEARANCE, CEILING_TILE = 0.05, 9.6
"""Height of the underside of the car of [A] above the floor, m, and metres after which the ceiling repeats itself."""

SKIRTING_COLOR, LID_COLOR = 51 | 48 << 8 | 46 << 16, 115 | 84 << 8 | 56 << 16

MARGIN, LEVELS = 4, 16
"""Texels around a texture that repeat its border, so that no filter sees its other side, and mipmaps at most."""

Corner = tuple[float, float, float, float, float]


class World(NamedTuple):
    """A building.

    The triangles, textures and mipmaps are those of the kernel `rasterise`; `[textures, LEVELS, 3]` mipmaps repeat
    their last one.
    """

    corners: Floats
    surface: npt.NDArray[np.int32]
    texels: npt.NDArray[np.uint32]
    mipmaps: npt.NDArray[np.int32]
    walls: Floats  # what the car cannot pass, [S, 2, 2]
    posts: Floats  # the same: x, y, radius, [C, 3]
    profiles: list[Floats]  # of each edge of each ring: brightness [columns] at the height of the cameras


class Quads:
    """Quads with texture coordinates; corners are counter-clockwise as seen from where the quad is visible."""

    def __init__(self) -> None:
        self.quads: list[list[Corner]] = []
        self.surface: list[int] = []

    def upright(
        self, start: Point, end: Point, z: Point, surface: int, u: Point = (0.0, 0.0), v: Point = (0.0, 0.0)
    ) -> None:
        """Add a vertical rectangle, visible from the left of the line from `start` to `end`."""
        low, high = (z[0], 1 - v[0]), (z[1], 1 - v[1])  # rows of a texture begin at its top
        ends = ((end, u[1], low), (start, u[0], low), (start, u[0], high), (end, u[1], high))
        self.quads.append([(x, y, at[0], across, at[1]) for (x, y), across, at in ends])
        self.surface.append(surface)

    def level(
        self, bounds: tuple[float, ...], z: float, surface: int, size: Point = (0.0, 0.0), down: bool = False
    ) -> None:
        """Add a horizontal rectangle with so many repetitions of its texture, visible from above or from below."""
        (left, right, bottom, top), (u, v) = bounds, size
        corners = [(left, bottom, 0.0, 1.0), (right, bottom, u, 1.0), (right, top, u, 1 - v), (left, top, 0.0, 1 - v)]
        self.quads.append([(x, y, z, a, b) for x, y, a, b in (corners[::-1] if down else corners)])
        self.surface.append(surface)


def build(plan: Plan, seed: int = 0, rig: StereoRig | None = None, body: Body | None = None) -> World:
    """Paint and build a plan. The seed decides what it looks like."""
    rng = np.random.default_rng((seed, 100))
    rig, body = rig or StereoRig(), body or Body()
    tops = [min(r.height or plan.height, plan.height) for r in plan.rings]
    surfaces = [texels for r, top in zip(plan.rings, tops, strict=True) for texels in ring_textures(r, top, rng)]
    reaches = [(r.bottom, top) for r, top in zip(plan.rings, tops, strict=True) for _ in r.points]
    floor, ground = floor_texture(plan, rng)
    edged = ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0))
    images = [floor, ceiling_texture(), *(np.pad(texels, edged, "edge") for texels in surfaces)]
    scene = Quads()
    add_skirting(scene, plan, closed=rig.camera_height < SKIRTING[1])
    for solid in plan.solids:
        if solid.height is not None and solid.height < plan.height and not solid.radius:
            sides = np.stack((solid.array.min(0), solid.array.max(0)), 1).ravel()
            scene.level(tuple(sides), solid.height - 0.001, LID_COLOR)
            if solid.bottom:
                scene.level(tuple(sides), solid.bottom + 0.001, LID_COLOR, down=True)
    for n, ((a, b), reach) in enumerate(zip(plan.segments, reaches, strict=True)):
        v, u = (MARGIN / size for size in images[2 + n].shape[:2])
        scene.upright(tuple(a), tuple(b), reach, 2 + n, (u, 1 - u), (v, 1 - v))
    scene.level(ground, 0.0, 0, (1.0, 1.0))
    repeated = ((ground[1] - ground[0]) / CEILING_TILE, (ground[3] - ground[2]) / CEILING_TILE)
    scene.level(ground, plan.height, 1, repeated, down=True)
    return World(
        np.array(scene.quads)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 5),
        np.repeat(scene.surface, 2).astype(np.int32),
        *with_mipmaps(images),
        *obstacles(plan, rig, body),
        [profile(s, (rig.camera_height - low) / (top - low)) for s, (low, top) in zip(surfaces, reaches, strict=True)],
    )


def add_skirting(scene: Quads, plan: Plan, closed: bool) -> None:
    """A dark board along the foot of the walls, as a mesh: in the texture, the filter would blur it away.

    Where cameras look from its own height, it is closed at corners: slits would be features in the rows.
    """
    kinds = [kind for shape in plan.rings for kind in shape.kinds]
    for ((ax, ay), (bx, by)), kind in zip(plan.segments, kinds, strict=True):
        if kind == "wall":
            length = math.hypot(bx - ax, by - ay)
            x, y = -(by - ay) / length * SKIRTING[0], (bx - ax) / length * SKIRTING[0]
            u, v = (y, -x) if closed else (0.0, 0.0)
            scene.upright((ax + x - u, ay + y - v), (bx + x + u, by + y + v), (0.0, SKIRTING[1]), -1 - SKIRTING_COLOR)


def obstacles(plan: Plan, rig: StereoRig, body: Body) -> tuple[Floats, Floats]:
    """Walls `[S, 2, 2]` and posts `[C, 3]` between the underside and the top of the car."""
    under = GROUND_CLEARANCE * min(1.0, body.unit_m)
    over = max(0.19 * body.unit_m, rig.camera_height - 0.01)
    walls, posts = [np.zeros((0, 2, 2))], [np.zeros((0, 3))]
    for shape in plan.rings:
        if shape.stops and shape.bottom < over and (shape.height is None or shape.height > under):
            if shape.radius:
                posts.append(np.array([[*shape.array.mean(0), shape.radius]]))
            else:
                walls.append(shape.sides)
    return np.concatenate(walls), np.concatenate(posts)


def profile(texels: Image, height: float) -> Floats:
    rows = len(texels)
    return np.asarray(texels[min(max(rows - 1 - int(height * rows), 0), rows - 1)].mean(-1) / 255.0)


def with_mipmaps(images: list[Image]) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.int32]]:
    levels, blocks, begin = np.zeros((len(images), LEVELS, 3), np.int32), [], 0
    for n, image in enumerate(images):
        for k in range(LEVELS):
            high, wide = image.shape[:2]
            levels[n, k:] = begin, wide, high
            red, green, blue = (image[..., c].astype(np.uint32) for c in range(3))
            blocks.append(np.pad(red | green << 8 | blue << 16, 1, "wrap").ravel())
            begin += blocks[-1].size
            if wide == high == 1:
                break
            half = max(wide // 2, 1), max(high // 2, 1)
            image = np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_LINEAR), np.uint8)
    return np.concatenate(blocks), levels
