"""Clips of insects in a dish from above, dark on light: they rest, touch, cross and walk along the rim; H.264."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from ndtorch.utils.files import replacing
from ndtorch_train.benchmark.base import Split
from ndtorch_train.benchmark.generated_clips import cloud, encode
from ndtorch_train.benchmark.mot import Box, LabelledClip, Pixels, TrueBox, TrueFrame, Video, VideoFrames
from ndtorch_train.benchmark.negative_clips import SEEDS

SIZE, FPS, FRAMES = (360, 360), 12.5, 500
DISH, RADIUS = (180.0, 180.0), 160.0
"""Middle of the dish and its radius, pixels."""
FLICKER, FLICKER_HZ = 0.03, 2.3
"""The lamp flickers by this share, as 100 Hz do in a camera of this rate."""
NOISE, QUALITY = 2.0, 23
"""Deviation of the sensor's noise in levels of 255, and constant rate factor of H.264."""
ELONGATION = 0.45
"""Width of an animal over its length."""

DISHES = {
    f"{count} of {lengths[0]}-{lengths[1]} px": (count, lengths)
    for count in (2, 5, 12)
    for lengths in ((8, 14), (15, 30))
}
"""Kinds of clips: number of animals, and shortest and longest, pixels."""


class Animal(NamedTuple):
    """Length in pixels, and row, column and heading (radians from rightward, down) in every frame, `[FRAMES, 3]`."""

    length: float
    path: npt.NDArray[np.float64]

    def box(self, n: int) -> Box:
        """Box of its ellipse in frame n."""
        row, column, heading = self.path[n].tolist()
        long, wide = self.length / 2, ELONGATION * self.length / 2
        across = math.hypot(long * math.cos(heading), wide * math.sin(heading))
        down = math.hypot(long * math.sin(heading), wide * math.cos(heading))
        return Box(column - across, row - down, column + across, row + down)


def draw_animal(rng: np.random.Generator, lengths: tuple[float, float]) -> Animal:
    """A correlated random walk of 2 to 5 lengths a second that rests for 5 to 30 s, and follows the rim."""
    length, path = rng.uniform(*lengths), np.empty((FRAMES, 3))
    inner, speed = RADIUS - 0.6 * length, rng.uniform(2, 5) * length
    heading, turn = rng.uniform(0, 2 * math.pi, 2)
    place = np.array(DISH) + inner * math.sqrt(rng.random()) * np.array((math.sin(turn), math.cos(turn)))
    rests, until = rng.random() < 0.7, 0.0
    for n in range(FRAMES):
        if n / FPS >= until:
            rests = not rests
            until = n / FPS + (rng.uniform(5, 30) if rests else rng.uniform(4, 15))
        if not rests:
            heading += rng.normal(0, 0.8 / math.sqrt(FPS))
            place = place + speed / FPS * np.array((math.sin(heading), math.cos(heading)))
            out = place - DISH
            far = math.hypot(*out)
            if far > inner:
                place = np.array(DISH) + out * inner / far
                along = math.atan2(*out) + math.pi / 2
                way = 1 if math.cos(heading - along) > 0 else -1
                heading = along + (0 if way > 0 else math.pi) + way * rng.uniform(0, 0.15)
        path[n] = *place, heading
    return Animal(length, path)


@functools.cache
def draw_animals(kind: str, seed: int) -> tuple[Animal, ...]:
    """The animals of a clip."""
    rng = np.random.default_rng([seed, list(DISHES).index(kind), 11])
    count, lengths = DISHES[kind]
    return tuple(draw_animal(rng, lengths) for _ in range(count))


def dish_frames(kind: str, seed: int) -> Iterator[Pixels]:
    """The frames, red, green, blue."""
    rng, animals = np.random.default_rng([seed, 3]), draw_animals(kind, seed)
    row, column = np.indices(SIZE)
    far = np.hypot(row - DISH[0], column - DISH[1])
    light = np.where(far < RADIUS, 205, 120) - 55 * np.exp(-(((far - RADIUS - 4) / 3) ** 2)) + 4 * cloud(rng, SIZE)
    ground = np.asarray(np.repeat(light[..., None], 3, 2) * (1, 0.98, 0.94), np.float32)
    noise = rng.normal(0, NOISE, (SIZE[0] + 40, SIZE[1] + 40, 3)).astype(np.float32)
    for n in range(FRAMES):
        image, scale = ground.copy(), 16
        for animal in animals:
            down, across, heading = animal.path[n].tolist()
            axes = round(animal.length / 2 * scale), round(ELONGATION * animal.length / 2 * scale)
            middle = round(across * scale), round(down * scale)
            cv2.ellipse(image, middle, axes, math.degrees(heading), 0, 360, (48, 42, 38), -1, cv2.LINE_AA, 4)
        image *= np.float32(1 + FLICKER * math.sin(2 * math.pi * FLICKER_HZ * n / FPS))
        top, left = rng.integers(0, 40, 2)
        image += noise[top : top + SIZE[0], left : left + SIZE[1]]
        yield np.asarray(np.clip(image, 0, 255), np.uint8)


def true_boxes(kind: str, seed: int) -> Iterator[TrueFrame]:
    """Boxes of all animals."""
    for n in range(FRAMES):
        yield TrueFrame([TrueBox(k, animal.box(n)) for k, animal in enumerate(draw_animals(kind, seed))])


def dish_clip(kind: str, split: Split, folder: Path) -> LabelledClip:
    """A clip of one kind, encoded in a folder unless it is there already, with its true boxes."""
    seed, path = SEEDS[split], folder / f"{kind.replace(' ', '-')}-{split}.mp4"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with replacing(path) as part:
            encode(dish_frames(kind, seed), part, FPS, SIZE, QUALITY)
    return LabelledClip(Video(kind, VideoFrames(path), FPS, SIZE), functools.partial(true_boxes, kind, seed))
