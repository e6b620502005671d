"""Clips without any object, drawn over one still image: weather, light, camera noise and shake, a screen."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError
from ndtorch.scenes.readers import quiet_opencv
from ndtorch_train.benchmark.base import Split
from ndtorch_train.benchmark.mot import Pixels

Floats = npt.NDArray[np.float32]
Chance = np.random.Generator

FPS = 25.0
TALL = 288.0
"""Rows of an image for which lengths in pixels hold; others are scaled."""

STREAKS = 60
"""Streaks of rain a frame on 288 x 384 pixels."""
SWING, SWING_S, JUMP, JUMP_S = 0.25, 8.0, 1.2, 10.0
"""The light swings by this share in so many seconds, and jumps by this factor up and down again after so many."""
PATCHES, SWAY = 6, 4.0
"""Patches of leaves, and by how many pixels they are moved at most."""
FLAKES, FLAKE = 150, 4.0
"""Flakes of snow on 288 x 384 pixels, and by how many pixels the radius of the nearest is larger."""
WATER, WAVES, RIPPLE, GLINT = 0.4, 8, 4.0, 0.5
"""Share of the image that is water, waves on it, by how many pixels they bend it, and how bright they glint."""
NIGHT, NIGHT_NOISE = 0.12, 0.02
"""What is left of the light at night, and the deviation of the noise then."""
NOISE = 0.05
"""Standard deviation of the noise of every pixel and color."""
SHAKE = 3.0
"""Most pixels by which a shaken camera moves the image."""
SCREEN, SHOT_S = 0.28, 3.0
"""Height of a screen in the image as a share of it, and mean time from one cut on it to the next."""


def noise(still: Floats, chance: Chance, count: int) -> Iterator[Floats]:
    """White noise of the camera."""
    for _ in range(count):
        yield still + np.float32(NOISE) * chance.standard_normal(still.shape, dtype=np.float32)


def shake(still: Floats, chance: Chance, count: int) -> Iterator[Floats]:
    """A camera on a mast in the wind: the image moves by one to three pixels, in gusts."""
    height, width = still.shape[:2]
    most = SHAKE * height / TALL
    parts = [(chance.uniform(0.8, 6), chance.uniform(0, 7), chance.uniform(0, 7)) for _ in range(4)]
    rows, columns = np.mgrid[0:height, 0:width].astype(np.float32)
    for n in range(count):
        t = n / FPS
        gust = most * (2 + math.sin(0.9 * t + parts[0][1])) / 3 / len(parts)
        across = gust * sum(math.sin(2 * math.pi * pace * t + a) for pace, a, _ in parts)
        down = gust * sum(math.sin(2 * math.pi * pace * t + b) for pace, _, b in parts)
        at = columns + np.float32(across), rows + np.float32(down)
        yield np.asarray(cv2.remap(still, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT), np.float32)


def screen(still: Floats, chance: Chance, count: int) -> Iterator[Floats]:
    """A screen that shows shots of blurred shapes, panned, with cuts, and lights the wall around it."""
    height, width = still.shape[:2]
    tall = round(SCREEN * height)
    wide = round(1.6 * tall)
    top, left = round(chance.uniform(0.1, 0.6) * height), round(chance.uniform(0.05, 0.55) * width)
    glow = np.zeros((height, width, 1), np.float32)
    glow[top : top + tall, left : left + wide] = 1
    glow = np.asarray(cv2.GaussianBlur(glow, (0, 0), 0.6 * tall), np.float32)[..., None]
    until, shot, pan = 0.0, np.zeros((1, 1, 3), np.float32), np.zeros(2)
    began = 0.0
    for n in range(count):
        t = n / FPS
        if t >= until:
            began, until = t, t + chance.uniform(0.3, 2 * SHOT_S - 0.3)
            coarse = chance.uniform(0, 1, (6, 9, 3)).astype(np.float32) * np.float32(chance.uniform(0.4, 1.0))
            shot = np.asarray(cv2.resize(coarse, (2 * wide, 2 * tall), interpolation=cv2.INTER_CUBIC), np.float32)
            pan = chance.uniform(-0.12, 0.12, 2) * height
        start = np.array([tall / 2, wide / 2]) + pan * (t - began)
        at = np.rint(start.clip(0, (tall, wide))).astype(int)
        shown = shot[at[0] : at[0] + tall, at[1] : at[1] + wide].clip(0, 1)
        image = still + 0.15 * glow * shown.mean((0, 1)) * still
        image[top : top + tall, left : left + wide] = shown
        yield np.asarray(image, np.float32)


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
        image, t = still.copy(), n / FPS
        for cover, pace, phase, heading in kinds:
            gust = 0.5 + 0.5 * math.sin(0.7 * t + phase)
            sway = scale * SWAY * gust * math.sin(2 * math.pi * pace * t + phase)
            at = columns + np.float32(sway * math.cos(heading)), rows + np.float32(sway * math.sin(heading))
            moved = cv2.remap(green, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
            share = cv2.remap(cover, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)[..., None]
            image += share * (moved - image)
        yield image


def snow(still: Floats, chance: Chance, count: int) -> Iterator[Floats]:
    """Flakes that fall and drift, the near ones larger, faster and less sharp."""
    height, width = still.shape[:2]
    scale = height / TALL
    flakes = round(FLAKES * width / height * 288 / 384)
    near = chance.uniform(0, 1, flakes) ** 3
    radius = scale * (0.8 + FLAKE * near)
    x, y = chance.uniform(0, width, flakes), chance.uniform(0, height, flakes)
    fall, phase = scale * (1.5 + 6 * near) * chance.uniform(0.8, 1.2, flakes), chance.uniform(0, 2 * math.pi, flakes)
    wind = scale * chance.uniform(-1.5, 1.5)
    for n in range(count):
        drops = np.zeros((height, width), np.float32)
        at = np.stack([x + 4 * scale * np.sin(phase + 2.5 * n / FPS), y], 1)
        for (column, row), size, close in zip(at.tolist(), radius.tolist(), near.tolist(), strict=True):
            # Sixteenths of a pixel, so that flakes glide.
            middle = round(16 * (column % width)), round(16 * row)
            cv2.circle(drops, middle, max(8, round(16 * size)), 0.8 - 0.4 * close, -1, cv2.LINE_AA, 4)
        x, y = x + wind * (0.5 + near), (y + fall) % height
        yield np.asarray(still + (0.95 - still).clip(0) * cv2.blur(drops, (2, 2))[..., None], np.float32)


def water(still: Floats, chance: Chance, count: int) -> Iterator[Floats]:
    """The lower part of the image mirrored in water whose waves bend it and glint."""
    height, width = still.shape[:2]
    scale, shore = height / TALL, round(height * (1 - WATER))
    rows, columns = np.mgrid[0 : height - shore, 0:width].astype(np.float32)
    # Far waves look shorter than near ones.
    deep = 1 / (0.35 + 0.65 * rows / max(1, height - shore))
    waves = []
    for _ in range(WAVES):
        number, heading = 2 * math.pi / (scale * chance.uniform(14, 60)), chance.uniform(0, math.pi)
        # Of waves on deep water short ones are slower: the pace goes with the root of the wave number.
        pace = 2 * math.pi * 0.9 * math.sqrt(number * scale * 30 / (2 * math.pi))
        along = number * deep * (columns * np.float32(math.cos(heading)) + 2.5 * rows * np.float32(math.sin(heading)))
        waves.append((along, pace, chance.uniform(0, 2 * math.pi), number))
    least = min(number for *_, number in waves)
    mirrored = still[shore - 1 :: -1][: height - shore]
    mirrored = np.concatenate([mirrored, np.repeat(mirrored[-1:], height - shore - len(mirrored), 0)])
    mirrored = np.asarray(0.25 * mirrored.mean((0, 1)) + 0.6 * mirrored, np.float32)
    for n in range(count):
        t, slope = n / FPS, np.zeros(rows.shape, np.float32)
        for along, pace, phase, number in waves:
            slope += np.float32(least / number) * np.sin(along - np.float32(pace * t + phase))
        slope /= math.sqrt(WAVES / 2)
        at = columns, rows + np.float32(scale * RIPPLE) * slope
        bent = cv2.remap(mirrored, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        glint = np.clip((slope - 0.8) * 1.2, 0, 1)[..., None] * np.float32(GLINT)
        image = still.copy()
        image[shore:] = bent + 0.04 * slope[..., None] + glint * (1 - bent)
        yield image


def nightfall(still: Floats, chance: Chance, count: int) -> Iterator[Floats]:
    """The scene gets dark and bluish, one side of the image first, and the camera's noise grows as it amplifies."""
    height, width = still.shape[:2]
    heading = chance.uniform(0, 2 * math.pi)
    rows, columns = np.mgrid[-0.5 : 0.5 : height * 1j, -0.5 : 0.5 : width * 1j].astype(np.float32)
    side = (rows * math.sin(heading) + columns * math.cos(heading))[..., None]
    for n in range(count):
        # Night is there after nine tenths of the clip.
        share = min(1.0, n / (0.9 * count))
        dark = np.clip(share * 1.6 - 0.3 - 0.3 * side, 0, 1)
        tint = np.array((1.15, 1.0, 0.85), np.float32)
        light = (1 - dark) + dark * np.float32(NIGHT) * tint
        deviation = np.float32(0.004 + NIGHT_NOISE * share)
        yield np.asarray(still * light + deviation * chance.standard_normal(still.shape, dtype=np.float32), np.float32)


SEEDS: dict[Split, int] = {"tune": 0, "test": 1_000_000}

SAMPLES = 25
"""Frames of a video whose median is its still image."""

KINDS: dict[str, Callable[[Floats, Chance, int], Iterator[Floats]]] = {
    "noise": noise,
    "rain": rain,
    "light": light,
    "leaves": leaves,
    "snow": snow,
    "water": water,
    "nightfall": nightfall,
    "shake": shake,
    "screen": screen,
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


def still_image(source: Path) -> Pixels:
    """An image, or the median of frames of a video, in which what passes is gone, blue, green, red."""
    if not source.is_file():
        raise InputError(f"{source}: no such file")
    with quiet_opencv():
        image = cv2.imread(str(source))
    if image is None:
        image = median_frame(source)
    if image is None or min(image.shape[:2]) < 32:
        raise InputError(f"{source} is not an image or video of 32 x 32 pixels or more")
    return np.asarray(image, np.uint8)


def median_frame(path: Path) -> Pixels | None:
    """The median of frames all over a video, pixel by pixel; None where there are none."""
    with quiet_opencv():
        capture = cv2.VideoCapture(str(path))
        step = max(1, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) // SAMPLES)
        frames, number = [], 0
        while capture.grab():
            if number % step == 0:
                there, frame = capture.retrieve()
                frames += [frame] if there else []
            number += 1
        capture.release()
    return np.median(np.stack(frames), 0).astype(np.uint8) if frames else None
