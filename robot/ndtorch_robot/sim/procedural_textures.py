"""What walls and floors look like: procedural textures from a seed, nowhere repeated."""

from __future__ import annotations

import itertools
import math
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch_robot.sim.plan import Floats, Plan, Ring

Walls = Literal["textured", "blank"]
Image = npt.NDArray[np.uint8]

ALONG, UPWARD = 256, 64
"""Texels per metre along a wall and upward: the cameras resolve 2 mm at 1 m along the row they range with."""

FLOOR = 128
"""Texels per metre of floor."""

COLORS = {
    "wall": (0.80, 0.77, 0.70),
    "blank": (0.78, 0.77, 0.74),
    "door": (0.42, 0.29, 0.20),
    "jamb": (0.66, 0.64, 0.60),
    "pillar": (0.58, 0.58, 0.60),
    "furniture": (0.55, 0.40, 0.26),
}


class Surface(NamedTuple):
    """One surface: `texels` `[rows, columns, 3]`, the top row first, from the start of the edge to its end.

    It reaches from `bottom` up to `height`, m.
    """

    texels: Image
    height: float
    bottom: float = 0.0


def ring_textures(shape: Ring, ceiling: float, rng: np.random.Generator, walls: Walls) -> list[Surface]:
    """The surfaces of a ring, one for each edge.

    Walls have panels up to 1 m with a rail above, uneven light, paper on them here and there, and some
    stretches without any texture. `walls="blank"` leaves all but the color away.
    """
    height = min(shape.height or ceiling, ceiling)
    corners = shape.array
    sides = np.roll(corners, -1, 0) - corners
    lengths = np.hypot(*sides.T)
    style = RingStyle(float(lengths.sum()), rng)
    rows = max(1, round((height - shape.bottom) * UPWARD))
    z = shape.bottom + (rows - np.arange(rows) - 0.5)[:, None] / UPWARD
    painted, begin = [], 0.0
    for (dx, dy), length, kind in zip(sides, lengths, shape.kinds, strict=True):
        columns = max(2, math.ceil(length * ALONG))
        s = (np.arange(columns) + 0.5) * (length / columns)
        # Light falls from one side, so that walls of different directions differ.
        lit = 0.9 + 0.1 * math.cos(math.atan2(dx, -dy) - 0.7)
        plain = walls == "blank" or kind == "blank"
        light = np.ones((rows, columns)) if plain else style.light(kind, s, begin, length, z, rng)
        color = np.array(COLORS[kind])
        texels = light[..., None] * lit * color
        if not plain and kind == "wall":
            style.paper(texels, begin + s, z)
        painted.append(Surface(to_bytes(texels), height, shape.bottom))
        begin += length
    return painted


class RingStyle:
    """The random choices for one ring, which go on over its corners: panels, unevenness, papers."""

    def __init__(self, length: float, rng: np.random.Generator) -> None:
        widths = rng.uniform(0.25, 1.3, size=int(length / 0.25) + 2)
        widths[rng.random(len(widths)) < 0.1] = 2.0
        self.ends = np.cumsum(widths)
        self.shade = rng.normal(0, 0.13, len(widths)).clip(-0.35, 0.2)
        self.texture = np.where(widths == 2.0, 0.0, rng.uniform(0.5, 1.5, len(widths)))
        self.knots = rng.normal(0, 0.04, int(length / 0.7) + 3)
        count = int(length / 2.5)
        self.papers = np.stack(
            (
                rng.uniform(0, length, count),
                rng.uniform(0.1, 0.45, count),
                rng.uniform(1.2, 1.5, count),
                rng.uniform(0.2, 0.4, count),
            ),
            -1,
        )
        self.tone = float(rng.uniform(0.85, 1.1))
        self.paper_colors = rng.uniform(0.25, 0.95, (count, 3))

    def light(self, kind: str, s: Floats, begin: float, length: float, z: Floats, rng: np.random.Generator) -> Floats:
        """Brightness `[rows, columns]` as a factor on the color."""
        along = begin + s
        uneven = np.interp(along, np.arange(len(self.knots)) * 0.7, self.knots)
        grain = rng.normal(0, 1, (len(z), len(s)))
        grain = (grain + np.roll(grain, 1, 1)) / math.sqrt(2)
        light = 1 + uneven + 0.04 * (z - 1.2)
        if kind == "wall":
            panel = np.searchsorted(self.ends, along)
            light = light + np.where(z < 1.0, self.shade[panel], 0.08)
            light = np.where((z >= 1.0) & (z < 1.04), 0.62, light)
            return np.asarray(light + 0.015 * grain * self.texture[panel])
        if kind == "door":
            frame = (s < 0.06) | (s > length - 0.06)
            shade = float(rng.uniform(0.8, 1.5))
            inset = (np.abs(s - length / 2) < length / 2 - 0.2) & (((z > 0.45) & (z < 0.95)) | ((z > 1.15) & (z < 1.9)))
            light = np.where(inset, light * shade * 0.85, light * shade)
            light = np.where(frame | (z > 2.05), 1.7 + uneven, light)
            return np.asarray(light + 0.02 * grain)
        if kind == "furniture":
            drawers = np.cumsum(rng.uniform(0.25, 0.5, int(length / 0.25) + 2))
            fronts = rng.uniform(0.7, 1.3, len(drawers) + 1)
            return np.asarray(light * fronts[np.searchsorted(drawers, s)] + 0.02 * grain)
        return np.asarray(light * self.tone + (0.03 if kind == "pillar" else 0.01) * grain)

    def paper(self, texels: Floats, along: Floats, z: Floats) -> None:
        """Put the papers that hang here on the wall, in place."""
        for (place, width, low, high), color in zip(self.papers, self.paper_colors, strict=True):
            texels[(np.abs(along - place) < width / 2) & (z > low) & (z < low + high)] = color


def floor_texture(plan: Plan, rng: np.random.Generator) -> tuple[Image, tuple[float, ...]]:
    """The floor under the whole building, and its bounds (left, right, bottom, top) in m.

    The brightness of its material varies on scales from 8 mm to half a metre; `Floor` has its spread and its pattern.
    """
    import cv2

    spread = plan.floor.spread

    left, right, bottom, top = plan.bounds
    columns, rows = math.ceil((right - left + 0.4) * FLOOR), math.ceil((top - bottom + 0.4) * FLOOR)
    carpet = np.zeros((rows, columns), np.float32)
    for texels, share in ((1, 0.55), (2, 0.55), (8, 0.45), (64, 0.45)):
        coarse = rng.standard_normal((rows // texels + 2, columns // texels + 2), dtype=np.float32)
        if texels > 1:
            coarse = np.asarray(
                cv2.resize(coarse, None, fx=texels, fy=texels, interpolation=cv2.INTER_CUBIC), np.float32
            )
        layer = coarse[:rows, :columns]
        carpet += layer * (share * spread / float(layer.std()))
    x = np.asarray(left - 0.2 + (np.arange(columns) + 0.5) / FLOOR, np.float32)
    y = np.asarray(bottom - 0.2 + (rows - np.arange(rows) - 0.5) / FLOOR, np.float32)
    light = plan.floor.light(x, y, 1 / FLOOR, rng)
    if light is not None:
        carpet = (0.45 + carpet) * light - 0.45
    image = to_bytes((0.45 + carpet)[..., None] * np.array([1.0, 0.97, 0.93], np.float32))
    return image, (left - 0.2, left - 0.2 + columns / FLOOR, bottom - 0.2, bottom - 0.2 + rows / FLOOR)


def ceiling_texture(rows: int = 256, columns: int = 256) -> Image:
    y, x = np.mgrid[0:rows, 0:columns]
    lamp = ((x // 16) % 4 == 1) & ((y // 16) % 4 == 1)
    joint = (x % 16 == 0) | (y % 16 == 0)
    return to_bytes(np.where(lamp, 0.98, np.where(joint, 0.62, 0.72))[..., None] * np.ones(3))


def to_bytes(values: npt.NDArray[np.floating]) -> Image:
    return np.asarray(np.clip(values * 255 + 0.5, 0, 255), dtype=np.uint8)


class AtlasRect(NamedTuple):
    """Where in the atlas a surface is: texture coordinates of its start, end, bottom and top."""

    start: float
    end: float
    bottom: float
    top: float


def pack(surfaces: list[Surface], width: int = 8192, margin: int = 4) -> tuple[Image, list[list[AtlasRect]]]:
    """All surfaces in one texture, and for each surface its patches; long ones are cut into several.

    Every patch has a margin that repeats its border, so that no filter sees its neighbours.
    """
    longest = width - 2 * margin
    pieces: list[tuple[int, Image]] = []
    for k, surface in enumerate(surfaces):
        columns = surface.texels.shape[1]
        parts = math.ceil(columns / longest)
        cuts = [round(columns * n / parts) for n in range(parts + 1)]
        pieces += [(k, surface.texels[:, a:b]) for a, b in itertools.pairwise(cuts)]
    places, x, y, tall = [], 0, 0, 0
    for _, texels in pieces:
        rows, columns = texels.shape[0] + 2 * margin, texels.shape[1] + 2 * margin
        if x + columns > width:
            x, y, tall = 0, y + tall, 0
        places.append((x, y))
        x, tall = x + columns, max(tall, rows)
    height = y + tall
    atlas = np.zeros((height, width, 3), np.uint8)
    patches: list[list[AtlasRect]] = [[] for _ in surfaces]
    for (k, texels), (x, y) in zip(pieces, places, strict=True):
        rows, columns = texels.shape[:2]
        padded = np.pad(texels, ((margin, margin), (margin, margin), (0, 0)), "edge")
        atlas[y : y + rows + 2 * margin, x : x + columns + 2 * margin] = padded
        u, v = x + margin, y + margin
        patches[k].append(AtlasRect(u / width, (u + columns) / width, 1 - (v + rows) / height, 1 - v / height))
    return atlas, patches


def profile(surface: Surface, height: float) -> Floats:
    """Brightness along a surface at one height, 0..1."""
    rows = len(surface.texels)
    share = (height - surface.bottom) / (surface.height - surface.bottom)
    row = min(max(rows - 1 - int(share * rows), 0), rows - 1)
    return np.asarray(surface.texels[row].mean(-1) / 255.0)
