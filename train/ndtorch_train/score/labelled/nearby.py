"""What is near a camera or in it, over a still picture in which nothing is there: noise, shake, a screen."""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np

from ndtorch_train.score.labelled.weather import FPS, TALL, Chance, Floats

NOISE = 0.05
"""Standard deviation of the noise of every pixel and color."""
SHAKE = 3.0
"""Most pixels by which a shaken camera moves the picture."""
SCREEN, SHOT_S = 0.28, 3.0
"""Height of a screen in the picture as a share of it, and mean time from one cut on it to the next."""


def noise(still: Floats, chance: Chance, count: int) -> Iterator[Floats]:
    """White noise of the camera."""
    for _ in range(count):
        yield still + np.float32(NOISE) * chance.standard_normal(still.shape, dtype=np.float32)


def shake(still: Floats, chance: Chance, count: int) -> Iterator[Floats]:
    """A camera on a mast in the wind: the picture moves by one to three pixels, in gusts."""
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
        picture = still + 0.15 * glow * shown.mean((0, 1)) * still
        picture[top : top + tall, left : left + wide] = shown
        yield np.asarray(picture, np.float32)
