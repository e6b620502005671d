"""Clips in which nothing is there: noise, rain, changing light and shaking leaves, drawn over one still picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError
from ndtorch.scenes.quiet import quiet_opencv
from ndtorch_train.score.choices import Split
from ndtorch_train.score.labelled.sight import Clip, Pixels
from ndtorch_train.score.labelled.truth import Labelled

Floats = npt.NDArray[np.float32]
Chance = np.random.Generator

FPS = 25.0
TALL = 288.0
"""Rows of a picture for which lengths in pixels hold; others are scaled."""
SEEDS: dict[Split, int] = {"tune": 0, "test": 1_000_000}

NOISE = 0.05
"""Standard deviation of the noise of every pixel and color."""
STREAKS = 60
"""Streaks of rain a frame on 288 x 384 pixels."""
SWING, SWING_S, JUMP, JUMP_S = 0.25, 8.0, 1.2, 10.0
"""The light swings by this share in so many seconds, and jumps by this factor up and down again after so many."""
PATCHES, SWAY = 6, 4.0
"""Patches of leaves, and by how many pixels they are moved at most."""


def noise(still: Floats, chance: Chance, count: int) -> Iterator[Floats]:
    """White noise of the camera."""
    for _ in range(count):
        yield still + np.float32(NOISE) * chance.standard_normal(still.shape, dtype=np.float32)


def rain(still: Floats, chance: Chance, count: int) -> Iterator[Floats]:
    """Light streaks, at other places in every frame."""
    height, width = still.shape[:2]
    scale = height / TALL
    slant = chance.uniform(-0.3, 0.3)
    for _ in range(count):
        drops = np.zeros((height, width), np.float32)
        for _ in range(round(STREAKS * height * width / (288 * 384 * scale))):
            length, x, y = scale * chance.uniform(6, 22), chance.uniform(0, width), chance.uniform(-10, height)
            ends = (round(x), round(y)), (round(x + slant * length), round(y + length))
            cv2.line(drops, *ends, float(chance.uniform(0.15, 0.4)), max(1, round(scale)), cv2.LINE_AA)
        yield np.asarray(still + (0.9 - still).clip(0) * drops[..., None], np.float32)


def light(still: Floats, chance: Chance, count: int) -> Iterator[Floats]:
    """The sun behind clouds, and a lamp that is switched on and off."""
    phase = chance.uniform(0, 2 * math.pi)
    for n in range(count):
        t = n / FPS
        gain = 1 + SWING * math.sin(2 * math.pi * t / SWING_S + phase) - SWING * math.sin(phase)
        yield still * np.float32(gain / 1.5 * (JUMP if int(t / JUMP_S) % 2 else 1.0))


def leaves(still: Floats, chance: Chance, count: int) -> Iterator[Floats]:
    """Patches of a fine texture that sway, each at its own pace and in gusts."""
    height, width = still.shape[:2]
    scale = height / TALL
    rows, columns = np.mgrid[0:height, 0:width].astype(np.float32)
    fine = cv2.GaussianBlur(chance.standard_normal((height, width, 1), dtype=np.float32), (0, 0), 2 * scale)
    texture = fine[..., None] / fine.std()
    green = np.array((0.15, 0.35, 0.2), np.float32) + texture * np.array((0.05, 0.12, 0.07), np.float32)
    kinds = []
    for _ in range(PATCHES):
        middle = chance.uniform(0.1, 0.9) * height, chance.uniform(0.1, 0.9) * width
        size = chance.uniform(0.06, 0.16) * height, chance.uniform(0.06, 0.16) * height
        apart = ((rows - middle[0]) / size[0]) ** 2 + ((columns - middle[1]) / size[1]) ** 2
        cover = np.clip((1.2 - apart) / 0.4, 0, 1).astype(np.float32)
        kinds.append((cover, chance.uniform(0.4, 1.2), chance.uniform(0, 7), chance.uniform(0, math.pi)))
    for n in range(count):
        picture, t = still.copy(), n / FPS
        for cover, pace, phase, way in kinds:
            gust = 0.5 + 0.5 * math.sin(0.7 * t + phase)
            sway = scale * SWAY * gust * math.sin(2 * math.pi * pace * t + phase)
            at = columns + np.float32(sway * math.cos(way)), rows + np.float32(sway * math.sin(way))
            moved = cv2.remap(green, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
            share = cv2.remap(cover, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)[..., None]
            picture += share * (moved - picture)
        yield picture


KINDS: dict[str, Callable[[Floats, Chance, int], Iterator[Floats]]] = {
    "noise": noise,
    "rain": rain,
    "light": light,
    "leaves": leaves,
}


@dataclass(frozen=True)
class Drawn:
    """The frames of such a clip; every loop over them draws the same again."""

    kind: str
    still: Pixels
    seed: int
    count: int

    def __iter__(self) -> Iterator[Pixels]:
        still = self.still.astype(np.float32) / np.float32(255)
        # One more number, so that no two kinds have the same chance.
        chance = np.random.default_rng((self.seed, list(KINDS).index(self.kind)))
        for frame in KINDS[self.kind](still, chance, self.count):
            yield (frame * np.float32(255) + np.float32(0.5)).clip(0, 255).astype(np.uint8)


def empty_clips(source: Path, seconds: float, split: Split) -> list[Labelled]:
    """One clip of each kind over a picture, or the first frame of a video.

    Raises:
        InputError: no picture there, or a time out of range.
    """
    if not 1 <= seconds <= 3600:
        raise InputError(f"empty-seconds must lie between 1 and 3600, got {seconds:g}")
    still = first_picture(source)
    count = round(seconds * FPS)
    return [
        Labelled(Clip(kind, Drawn(kind, still, SEEDS[split], count), FPS, still.shape[:2]), "none", source)
        for kind in KINDS
    ]


def first_picture(source: Path) -> Pixels:
    """A picture, or the first frame of a video, blue, green, red.

    Raises:
        InputError: neither.
    """
    if not source.is_file():
        raise InputError(f"{source}: no such file")
    with quiet_opencv():
        picture = cv2.imread(str(source))
        if picture is None:
            capture = cv2.VideoCapture(str(source))
            _, picture = capture.read()
            capture.release()
    if picture is None or min(picture.shape[:2]) < 32:
        raise InputError(f"{source} is no picture or video of 32 x 32 pixels or more")
    return np.asarray(picture, np.uint8)
