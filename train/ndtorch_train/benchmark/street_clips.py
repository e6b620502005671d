"""Clips drawn to be hard for background subtraction: crowds, lanes, covers, long shadows, moving cameras, insects."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from ndtorch_train.benchmark.base import Split
from ndtorch_train.benchmark.generated_clips import cloud
from ndtorch_train.benchmark.mot import Box, LabelledClip, Pixels, TrueBox, TrueFrame, Video
from ndtorch_train.benchmark.negative_clips import SEEDS

Floats = npt.NDArray[np.float32]
SIZE, FPS, FRAMES = (180, 320), 12.5, 200
MARGIN = 40
"""Pixels of the ground around the image, for cameras that move."""
NOISE = 0.01
"""Deviation of the sensor's noise."""


class Sprite(NamedTuple):
    """One object: height and width in pixels, color, where its middle is at a time (row and column), its shape
    ("figure", "car" or "disc"), and the length of its shadow in its own heights."""

    size: tuple[float, float]
    color: tuple[float, float, float]
    path: Callable[[float], tuple[float, float]]
    shape: str = "figure"
    shadow: float = 0.0


class Scene(NamedTuple):
    """What is drawn: sprites, light of the ground, whether something near swings before it, and how the camera moves
    (pixels down and across at a time)."""

    sprites: list[Sprite]
    ground: float = 0.5
    cover: bool = False
    camera: Callable[[float], tuple[float, float]] | None = None


def straight(
    row: float, start: float, speed: float, stop: tuple[float, float] = (0, 0)
) -> Callable[[float], tuple[float, float]]:
    """A path along a row, from a column at pixels a second, that stands from a time for some seconds."""

    def place(time: float) -> tuple[float, float]:
        return row, start + speed * (time - min(max(time - stop[0], 0.0), stop[1]))

    return place


def wander(rng: np.random.Generator, speed: float, rest: float, dish: bool) -> Callable[[float], tuple[float, float]]:
    """A path of turns, in a tank or a round dish, that rests for a share of the time."""
    steps, heading = np.empty((FRAMES + 1, 2)), rng.uniform(0, 2 * math.pi)
    at, middle = rng.uniform((50, 90), (130, 230)), np.array((90.0, 160.0))
    rests, until = rng.random() < rest, rng.uniform(1, 4)
    for n in range(FRAMES + 1):
        steps[n] = at
        if n / FPS > until:
            rests, until = rng.random() < rest, n / FPS + rng.uniform(1, 4)
        heading += rng.normal(0, 0.25)
        inside = np.hypot(*(at - middle)) < 75 if dish else (12 < at[0] < 168 and 20 < at[1] < 300)
        if not inside:
            heading = math.atan2(middle[1] - at[1], middle[0] - at[0]) + rng.normal(0, 0.3)
        if not rests:
            at = at + speed / FPS * np.array((math.cos(heading), math.sin(heading)))
    return lambda time: tuple(steps[round(time * FPS)].tolist())


def coat(rng: np.random.Generator) -> tuple[float, float, float]:
    """A color of clothes, unlike the ground."""
    light = rng.choice((0.18, 0.28, 0.75, 0.85))
    red, green, blue = np.clip(light + rng.normal(0, 0.08, 3), 0.05, 0.95).tolist()
    return red, green, blue


def draw_scene(kind: str, seed: int) -> Scene:
    """The sprites of a kind of clip."""
    rng = np.random.default_rng([seed, sorted(STREETS).index(kind)])
    if kind == "street":
        people = []
        for n in range(9):
            tall, way = (30, 46, 66)[n % 3], 1 if rng.random() < 0.5 else -1
            stop = (rng.uniform(1, 6), rng.uniform(3, 8)) if n % 3 == 0 else (0.0, 0.0)
            path = straight(60 + 0.8 * tall, rng.uniform(20, 300), way * 0.35 * tall, stop)
            people.append(Sprite((tall, 0.36 * tall), coat(rng), path))
        return Scene(people)
    if kind == "lanes":
        gap, cars = rng.uniform(4, 24), []
        for n in range(10):
            lane, speed = n % 2, rng.uniform(45, 55)
            path = straight(80 + lane * (18 + gap), -40 - 75 * (n // 2) - rng.uniform(0, 20), speed)
            cars.append(Sprite((18, 40), coat(rng), path, "car"))
        return Scene(cars)
    if kind == "abreast":
        groups = []
        for group in range(3):
            speed = (18 if group % 2 else -18) * rng.uniform(0.9, 1.1)
            start = rng.uniform(-60, 0) if speed > 0 else 320 + rng.uniform(0, 60)
            groups += [Sprite((44, 15), coat(rng), straight(50 + 40 * group, start + 20 * k, speed)) for k in range(3)]
        return Scene(groups)
    if kind == "cover":
        return Scene([Sprite((50, 18), coat(rng), straight(100, -20 - 60 * n, 28)) for n in range(5)], cover=True)
    if kind == "swimmers":
        return Scene([Sprite((5, 24), coat(rng), wander(rng, 25, 0.1, False), "car") for _ in range(14)])
    if kind == "dancers":

        def dance(row: float, column: float, phase: float) -> Callable[[float], tuple[float, float]]:
            return lambda t: (row + 3 * math.sin(7 * t + phase), column + 9 * math.sin(4 * t + 2 * phase))

        return Scene([Sprite((70, 26), coat(rng), dance(100, 70 + 90 * n, rng.uniform(0, 6))) for n in range(3)])
    if kind == "dark cars":
        road = 0.7
        dark = [(0.3 * road,) * 3, (0.34 * road, 0.33 * road, 0.32 * road)]
        paths = [straight(60 + 30 * (n % 3), -20 - 55 * (n // 3) - 15 * (n % 3), 40) for n in range(12)]
        return Scene([Sprite((12, 22), dark[n % 2], path, "car") for n, path in enumerate(paths)], road)
    if kind == "low sun":
        paths = [
            straight(70 + 22 * (n % 3), -20 - 60 * n if n % 2 else 340 + 60 * n, 24 * (1 if n % 2 else -1))
            for n in range(6)
        ]
        return Scene([Sprite((40, 14), coat(rng), path, shadow=1.0) for path in paths])
    if kind in ("panning", "shaking"):
        people = [Sprite((44, 16), coat(rng), straight(70 + 15 * n, 40 + 60 * n, 15 * (-1) ** n)) for n in range(4)]
        wobble = rng.uniform(0, 6, 4)
        if kind == "panning":
            return Scene(people, camera=lambda t: (0.0, 35 * math.sin(0.5 * t + wobble[0])))
        return Scene(people, camera=lambda t: (4 * math.sin(9 * t + wobble[1]), 5 * math.sin(13 * t + wobble[2])))
    side = 9.0 if kind == "small insects" else 14.0
    flies = [Sprite((side, 0.6 * side), (0.15, 0.13, 0.12), wander(rng, 22, 0.4, True), "disc") for _ in range(5)]
    return Scene(flies, 0.75)


STREETS = (
    "street", "lanes", "abreast", "cover", "swimmers", "dancers", "dark cars", "low sun", "panning", "shaking",
    "insects", "small insects",
)  # fmt: skip
"""Kinds of clips."""


def silhouette(sprite: Sprite, time: float, row: float, column: float, size: tuple[int, int]) -> Floats:
    """How much of every pixel an object covers, `[h, w]`: a body with a head and legs that stride, a car, a disc."""
    tall, wide = sprite.size
    mask, scale = np.zeros(size, np.uint8), 8

    def fixed(x: float, y: float) -> tuple[int, int]:
        """In eighths of a pixel."""
        return round(x * scale), round(y * scale)

    if sprite.shape == "car":
        corners = (fixed(column - wide / 2, row - tall / 2), fixed(column + wide / 2, row + tall / 2))
        cv2.rectangle(mask, *corners, 255, -1, cv2.LINE_AA, 3)
    elif sprite.shape == "disc":
        cv2.ellipse(mask, fixed(column, row), fixed(wide / 2, tall / 2), 0, 0, 360, 255, -1, cv2.LINE_AA, 3)
    else:
        stride, top = 0.4 * wide * math.sin(5 * time + sprite.color[0] * 50), row - tall / 2
        cv2.circle(mask, fixed(column, top + 0.1 * tall), round(0.1 * tall * scale), 255, -1, cv2.LINE_AA, 3)
        body = (fixed(column, top + 0.36 * tall), fixed(0.3 * wide, 0.2 * tall))
        cv2.ellipse(mask, *body, 0, 0, 360, 255, -1, cv2.LINE_AA, 3)
        for way in (-1, 1):
            ends = (fixed(column, top + 0.5 * tall), fixed(column + way * stride, top + 0.97 * tall))
            cv2.line(mask, *ends, 255, max(2, round(0.2 * wide)), cv2.LINE_AA, 3)
            hand = fixed(column - way * (0.35 * wide + 0.3 * stride), top + 0.5 * tall)
            cv2.line(mask, fixed(column, top + 0.25 * tall), hand, 255, max(1, round(0.12 * wide)), cv2.LINE_AA, 3)
    return np.asarray(mask / 255, np.float32)


class StreetFrames:
    """The frames of one clip, blue, green, red; every loop over them draws them again."""

    def __init__(self, kind: str, seed: int) -> None:
        self.kind, self.seed = kind, seed

    def __iter__(self) -> Iterator[Pixels]:
        scene, rng = draw_scene(self.kind, self.seed), np.random.default_rng([self.seed, 5])
        tall, wide = (side + 2 * MARGIN for side in SIZE)
        ground = scene.ground * (1 + 0.12 * cloud(rng, (tall, wide), 0.3, 4))[..., None] * (1, 0.97, 0.94)
        leaf = (0.3 + 0.1 * cloud(rng, (tall, wide), 0.05, 3))[..., None] * np.array((0.7, 1.2, 0.6))
        for n in range(FRAMES):
            time, image = n / FPS, np.asarray(ground, np.float32).copy()
            for sprite in sorted(scene.sprites, key=lambda one: one.path(time)[0] + one.size[0] / 2):
                row, column = (place + MARGIN for place in sprite.path(time))
                if not -80 < column < wide + 80:
                    continue
                mask = silhouette(sprite, time, row, column, (tall, wide))
                if sprite.shadow:
                    foot, slant = row + sprite.size[0] / 2, sprite.shadow
                    cast = np.array([[1, -slant, slant * foot], [0, -0.35, 1.35 * foot]], np.float32)
                    image *= 1 - 0.45 * cv2.warpAffine(mask, cast, (wide, tall))[..., None]
                image += mask[..., None] * (np.array(sprite.color, np.float32) - image)
            if scene.cover:
                for k in range(5):
                    middle = MARGIN + 32 + 64 * k + 8 * math.sin(2.2 * time + k)
                    image[MARGIN : MARGIN + 130, round(middle) - 14 : round(middle) + 14] = leaf[
                        20:150, 64 * k : 64 * k + 28
                    ]
            down, across = (0.0, 0.0) if scene.camera is None else scene.camera(time)
            shift = np.array([[1, 0, -MARGIN - across], [0, 1, -MARGIN - down]], np.float32)
            image = np.asarray(cv2.warpAffine(image, shift, SIZE[::-1]), np.float32)
            image += NOISE * rng.standard_normal(image.shape, np.float32)
            yield np.asarray(cv2.convertScaleAbs(np.maximum(image, 0), alpha=255.0)[..., ::-1], np.uint8)


def true_boxes(kind: str, seed: int) -> Iterator[TrueFrame]:
    """Boxes of all that is at least half in view, as the camera sees them."""
    scene = draw_scene(kind, seed)
    for n in range(FRAMES):
        time, found = n / FPS, []
        down, across = (0.0, 0.0) if scene.camera is None else scene.camera(time)
        for k, sprite in enumerate(scene.sprites):
            (row, column), (tall, wide) = sprite.path(time), sprite.size
            row, column = row - down, column - across
            if 0 <= row < SIZE[0] and 0 <= column < SIZE[1]:
                box = Box(column - wide / 2, row - tall / 2, column + wide / 2, row + tall / 2)
                found.append(TrueBox(k, box))
        yield TrueFrame(list(found))


def street_clip(kind: str, split: Split) -> LabelledClip:
    """A clip of one kind, with its true boxes."""
    seed = SEEDS[split]
    clip = Video(kind, StreetFrames(kind, seed), FPS, SIZE)
    return LabelledClip(clip, functools.partial(true_boxes, kind, seed))
