"""`ndtorch benchmark shape-identification`: a shape that only common motion shows, named among two.

The protocol is that of Tangemann, Kümmerer & Bethge (NeurIPS 2024): 256 x 256 pixels, 30 frames in a second, white
dots on grey, 16 to 512 in a square of 128 pixels. The dots of the shape move one way and those of the ground another,
each at up to 64 pixels a second, and appear anew after half a second to a second. Shapes are those of infinite
dSprites. What is segmented is compared with the shape and with a second one: the larger IoU is the answer.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from ndtorch.errors import InputError
from ndtorch.vision.figure_ground import figure_ground
from ndtorch_train.benchmark.base import Benchmark, Column, Row, Split, Task, known
from ndtorch_train.benchmark.foreground import mask_iou

Floats = npt.NDArray[np.float64]
Frames = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]

SIDE, LENGTH = 256, 30
"""Pixels of a side, and frames of a second."""
FIRST_SEED = {"tune": 40_000_000, "test": 41_000_000}
"""Film i has this seed plus i."""


class DotCondition(NamedTuple):
    """How films are drawn.

    Attributes:
        fastest: largest speed of figure and ground, pixels a second.
        density: least and most dots in a square of 128 pixels.
        lifetime: shortest and longest of a dot, frames.
        noise: dots at a new random place in each frame, as a multiple of the ground's.
        frames: that are seen.
    """

    fastest: float = 64.0
    density: tuple[float, float] = (16.0, 512.0)
    lifetime: tuple[float, float] = (15.0, 30.0)
    noise: float = 0.0
    frames: int = LENGTH


CONDITIONS: Mapping[str, DotCondition] = {
    "plain": DotCondition(),
    "fast": DotCondition(fastest=128.0),
    "short-lived": DotCondition(lifetime=(4.0, 6.0)),
    "noise": DotCondition(noise=2.0),
}
"""Every condition by its name."""


def outline(rng: np.random.Generator) -> Floats:
    """A closed smooth curve `[1000, 2]` through five to eight corners, its box of side 1 along its axes."""
    count = rng.integers(5, 9)
    angle = 2 * np.pi * (np.arange(count) + rng.normal(0, 0.25, count).clip(-0.5, 0.5)) / count
    corners = rng.normal(1, 0.4, count).clip(0.1, 1.9)[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    corners = np.concatenate([corners, corners[:1]])
    along = np.append(0, np.linalg.norm(np.diff(corners, axis=0), axis=-1).cumsum())
    path = CubicSpline(along, corners, bc_type="periodic")(np.linspace(0, along[-1], 1000))
    path = path - path.mean(0)
    path = path @ np.linalg.svd(path, full_matrices=False)[2].T
    return np.asarray(path / np.ptp(path, 0))


class DotFilm:
    """A film of dots and its two shapes.

    Args:
        seed: of everything.
        condition: how it is drawn.

    Attributes:
        frames: `[T, H, W]`.
        velocity, ground: pixels a frame, columns and rows.
    """

    def __init__(self, seed: int, condition: DotCondition) -> None:
        rng = np.random.default_rng(seed)
        turn, scale = rng.uniform(0, 2 * np.pi), rng.uniform(0.4, 1) * SIDE / 2
        turned = scale * np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        self.shapes = [outline(rng) @ turned for _ in range(2)]
        speed, direction = rng.uniform(0, condition.fastest, 2) / LENGTH, rng.uniform(0, 2 * np.pi, 2)
        self.velocity, self.ground = speed[:, None] * np.stack([np.cos(direction), np.sin(direction)], -1)
        density, life = rng.uniform(*condition.density), round(rng.uniform(*condition.lifetime))
        dots = rng.uniform(0, SIDE, (int(4 * density), 2))
        inner = self.inside(rng, 0, int(4 * density * self.mask(0, 0).mean()))
        ages = rng.integers(0, life, len(dots)), rng.integers(0, life, len(inner))
        images = []
        for t in range(condition.frames):
            for place, velocity, age in ((dots, self.ground, ages[0]), (inner, self.velocity, ages[1])):
                place += velocity
                age += 1
                new = age >= life
                place[new] = self.inside(rng, t, new.sum()) if place is inner else rng.uniform(0, SIDE, (new.sum(), 2))
                place %= SIDE
                age[new] = 0
            column, row = dots.astype(int).clip(0, SIDE - 1).T
            outside = dots[~self.mask(0, t)[row, column]]
            noise = rng.uniform(0, SIDE, (int(condition.noise * len(dots)), 2))
            images.append(self.image(np.concatenate([inner, outside, noise])))
        self.frames: Frames = np.stack(images)

    def mask(self, shape: int, t: int) -> Mask:
        """Pixels of the shown shape, 0, or of the other one, 1, in a frame; it is in the middle half-way."""
        middle = SIDE / 2 + (2 * t / (LENGTH - 1) - 1) * self.velocity * LENGTH / 2
        image = np.zeros((SIDE, SIDE), np.uint8)
        cv2.fillPoly(image, [np.rint(self.shapes[shape] + middle).astype(np.int32)], 1)
        return image > 0

    def inside(self, rng: np.random.Generator, t: int, count: int) -> Floats:
        """Places of dots within the shape, column and row, `[count, 2]`."""
        pixels = np.argwhere(self.mask(0, t))[:, ::-1]
        return pixels[rng.choice(len(pixels), count, replace=False)].astype(float)

    @staticmethod
    def image(dots: Floats) -> Frames:
        """Dots of 3 x 3 pixels, white on grey."""
        image = np.full((SIDE + 4, SIDE + 4), 128, np.uint8)
        for offset in np.ndindex(3, 3):
            column, row = (np.rint(dots).astype(int) + offset + 1).clip(0, SIDE + 3).T
            image[row, column] = 255
        return image[2:-2, 2:-2]


def flow_mask(frames: Frames) -> Mask:
    """The mask of dense optical flow (DIS): averaged, compared with its median, Otsu's threshold, largest part."""
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    mean = np.zeros((SIDE, SIDE, 2), np.float32)
    for before, now in itertools.pairwise(frames):
        mean += (dis.calc(before, now, np.zeros((SIDE, SIDE, 2), np.float32)) - mean) / (1 + 0.2 * LENGTH)
    smooth = cv2.GaussianBlur(mean, (0, 0), 4)
    apart = np.linalg.norm(smooth - np.median(smooth, (0, 1)), axis=-1)
    grey = cv2.normalize(apart, np.empty_like(apart), 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    _, above = cv2.threshold(grey, 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(above)
    largest = stats[1:, cv2.CC_STAT_AREA].argmax() if len(stats) > 1 else 0
    return np.asarray(np.equal(labels, 1 + largest))


METHODS: Mapping[str, Callable[[Frames], Mask]] = {
    "figure-ground": lambda frames: figure_ground(frames).mask,
    "flow": flow_mask,
}
"""Every method by its name: the mask of the last frame of a film."""


def measure(case: str, method: str, split: Split, films: int, out: Path) -> list[Row]:
    """The row of a method under a condition."""
    right, overlap = 0, 0.0
    for n in range(films):
        film = DotFilm(FIRST_SEED[split] + n, CONDITIONS[case])
        mask = METHODS[method](film.frames)
        shown, other = (mask_iou(mask, film.mask(shape, len(film.frames) - 1)) for shape in (0, 1))
        right += shown > other
        overlap += shown
    return [{"case": case, "method": method, "right": right / films, "iou": overlap / films}]


COLUMNS = (
    Column("case", "condition"),
    Column("method", "method"),
    Column("right", "right of two", better=1),
    Column("iou", "IoU", better=1),
)


def shape_benchmark(methods: Sequence[str], names: Sequence[str], films: int, split: Split) -> Benchmark:
    """The benchmark of some methods under some conditions; of all where none are named."""
    methods, names = methods or list(METHODS), names or list(CONDITIONS)
    known("methods", methods, list(METHODS))
    known("conditions", names, list(CONDITIONS))
    if not 1 <= films <= 10_000:
        raise InputError(f"films must be between 1 and 10000, got {films}")
    tasks = [
        Task(f"{case}, {method}", functools.partial(measure, case, method, split, films))
        for case in names
        for method in methods
    ]
    note = f"Split {split}, {films} films a condition. Masks of the last frame."
    return Benchmark(
        "shape-identification", "Shapes by common fate", note, COLUMNS, tasks,
        settings={"split": split, "films": films},
    )  # fmt: skip
