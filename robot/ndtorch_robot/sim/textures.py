"""What walls and floors look like: procedural textures from a seed, nowhere repeated."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch_robot.sim.plan import Pattern, Plan, Ring

Image = npt.NDArray[np.uint8]
Array = npt.NDArray[Any]

ALONG, UPWARD, FLOOR = 256, 64, 128
"""Texels per metre along a wall, upward, and of floor: the cameras resolve 2 mm at 1 m along the row they range."""

COLORS = {
    "wall": (0.80, 0.77, 0.70),
    "blank": (0.78, 0.77, 0.74),
    "door": (0.42, 0.29, 0.20),
    "jamb": (0.66, 0.64, 0.60),
    "pillar": (0.58, 0.58, 0.60),
    "furniture": (0.55, 0.40, 0.26),
}
"""What a surface can look like."""

PATTERNS: dict[str, tuple[float, float, float]] = {
    "carpet": (1.0, 0.0, 0.03),
    "tiles": (0.3, 0.006, 0.01),
    "checker": (0.25, 0.0, 0.01),
    "smooth": (1.0, 0.0, 0.0015),
    "lines": (2.5, 0.03, 0.03),
}
"""Metres from joint to joint, check to check and line to line; how wide joints and lines are, m; and the
standard deviation of the brightness of the material itself, where one level of 256 is 0.004."""

DARK, CHECKS, TONES = 0.35, (0.65, 1.35), 0.05
"""Brightness of joints and lines, and of the two kinds of checks, relative to the floor; spread of whole tiles."""


def floor_light(pattern: Pattern, x: Array, y: Array, rng: np.random.Generator) -> Array | float:
    """Brightness of texels at those middles, m, as a factor `[rows, columns]`; `"lines"` lie across x."""
    if pattern in ("carpet", "smooth"):
        return 1.0
    step, width, _ = PATTERNS[pattern]
    column, row = np.floor(x / step).astype(int), np.floor(y / step).astype(int)
    if pattern == "checker":
        return np.where((column + row[:, None]) % 2 == 1, *CHECKS).astype(np.float32)
    away = [np.abs(axis - np.round(axis / step) * step) for axis in (x, y)]
    joints = [np.clip(((width + 1 / FLOOR) / 2 - a) * FLOOR, 0.0, min(1.0, width * FLOOR)) for a in away]
    across, along = (1 - (1 - DARK) * joint.astype(np.float32) for joint in joints)
    if pattern == "lines":
        return np.asarray(across)
    column, row = column - column.min(), row - row.min()
    tones = 1 + TONES * rng.standard_normal((row.max() + 1, column.max() + 1))
    return np.asarray(tones[row][:, column] * np.minimum(across, along[:, None]), np.float32)


def ring_textures(shape: Ring, height: float, rng: np.random.Generator) -> list[Image]:
    """Texels `[rows, columns, 3]` of each surface of a ring up to a height, m, from the start of its edge to its end.

    The top row comes first. Walls have panels up to 1 m with a rail above, uneven light, paper on them here and
    there, and some stretches without any texture.
    """
    sides = shape.sides[:, 1] - shape.sides[:, 0]
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
        plain = kind == "blank"
        light = np.ones((rows, columns)) if plain else style.light(kind, s, begin, length, z, rng)
        texels = light[..., None] * lit * np.array(COLORS[kind])
        if not plain and kind == "wall":
            for (middle, width, low, high), color in zip(style.papers, style.paper_colors, strict=True):
                texels[(np.abs(begin + s - middle) < width / 2) & (z > low) & (z < low + high)] = color
        painted.append(to_bytes(texels))
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
        ranges = ((0.0, length), (0.1, 0.45), (1.2, 1.5), (0.2, 0.4))  # middle, width, lower side, height
        self.papers = np.stack([rng.uniform(low, high, count) for low, high in ranges], -1)
        self.tone = float(rng.uniform(0.85, 1.1))
        self.paper_colors = rng.uniform(0.25, 0.95, (count, 3))

    def light(self, kind: str, s: Array, begin: float, length: float, z: Array, rng: np.random.Generator) -> Array:
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


def floor_texture(plan: Plan, rng: np.random.Generator) -> tuple[Image, tuple[float, float, float, float]]:
    """The floor under the whole building, and its bounds (left, right, bottom, top) in m.

    The brightness of its material varies on scales from 8 mm to half a metre.
    """
    import cv2

    left, right, bottom, top = plan.bounds
    columns, rows = math.ceil((right - left + 0.4) * FLOOR), math.ceil((top - bottom + 0.4) * FLOOR)
    carpet = np.zeros((rows, columns), np.float32)
    for texels, weight in ((1, 0.55), (2, 0.55), (8, 0.45), (64, 0.45)):
        coarse = rng.standard_normal((rows // texels + 2, columns // texels + 2), dtype=np.float32)
        if texels > 1:
            coarse = np.asarray(cv2.resize(coarse, None, fx=texels, fy=texels, interpolation=cv2.INTER_CUBIC))
        layer = coarse[:rows, :columns]
        carpet += layer * (weight * PATTERNS[plan.floor][2] / float(layer.std()))
    x = np.asarray(left - 0.2 + (np.arange(columns) + 0.5) / FLOOR, np.float32)
    y = np.asarray(bottom - 0.2 + (rows - np.arange(rows) - 0.5) / FLOOR, np.float32)
    carpet = (0.45 + carpet) * floor_light(plan.floor, x, y, rng)
    image = to_bytes(carpet[..., None] * np.array([1.0, 0.97, 0.93], np.float32))
    return image, (left - 0.2, left - 0.2 + columns / FLOOR, bottom - 0.2, bottom - 0.2 + rows / FLOOR)


def ceiling_texture() -> Image:
    y, x = np.mgrid[0:256, 0:256]
    lamp = ((x // 16) % 4 == 1) & ((y // 16) % 4 == 1)
    joint = (x % 16 == 0) | (y % 16 == 0)
    return to_bytes(np.where(lamp, 0.98, np.where(joint, 0.62, 0.72))[..., None] * np.ones(3))


def to_bytes(values: Array) -> Image:
    return np.asarray(np.clip(values * 255 + 0.5, 0, 255), dtype=np.uint8)
