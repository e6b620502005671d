"""Draws the frames of a generated clip: texture, light and shadow, things in front, a camera's exposure and noise."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ndtorch_train.score.video_clips import Clip, Mover

Floats = npt.NDArray[np.float32]
Frame = npt.NDArray[np.uint8]

# Noise is cut from one larger sheet at random places: fresh noise for every frame costs as much as the rest.
NOISE_MARGIN = 61


def cloud(rng: np.random.Generator, size: tuple[int, int], coarsest: float = 0.3, octaves: int = 4) -> Floats:
    """Texture with detail at several scales, zero mean and unit deviation, `[H, W]`."""
    out = np.zeros(size, np.float32)
    for k in range(octaves):
        cell = max(1.5, coarsest * size[0] / 2.2**k)
        grid = rng.standard_normal((max(2, round(size[0] / cell)) + 1, max(2, round(size[1] / cell)) + 1))
        big = cv2.resize(grid.astype(np.float32), (size[1], size[0]), interpolation=cv2.INTER_CUBIC)
        out += np.asarray(big, np.float32) * 0.75**k
    return np.asarray((out - out.mean()) / max(float(out.std()), 1e-6), np.float32)


def smooth_noise(rng: np.random.Generator, count: int, tau: float, dt: float) -> Floats:
    """Low-passed noise of unit deviation, `[count]`."""
    a = dt / (tau + dt)
    out, low = np.zeros(count, np.float32), 0.0
    for n in range(count):
        low += a * (rng.standard_normal() - low)
        out[n] = low
    return np.asarray(out / math.sqrt(a / (2 - a)), np.float32)


class Painter:
    """The frames of one clip, in order."""

    def __init__(self, clip: Clip) -> None:
        self.clip = clip
        self.rng = rng = np.random.default_rng([clip.seed, clip.count, round(clip.fps * 10), 7])
        height, width = clip.size
        ground = np.asarray(clip.ground, np.float32)
        light = 1 + clip.ground_contrast * cloud(rng, clip.size)
        tints = [1 + 0.3 * clip.ground_contrast * cloud(rng, clip.size, 0.6, 2) for _ in range(3)]
        scene = ground * np.stack([light * tint for tint in tints], -1)
        self.front = np.zeros(clip.size, np.float32)
        for top, left, tall, wide in clip.occluders:
            mask = np.zeros(clip.size, np.float32)
            mask[cells(top, tall, height, height), cells(left, wide, height, width)] = 1
            mask = np.asarray(cv2.GaussianBlur(mask, (0, 0), 0.8), np.float32)
            color = rng.uniform(0.15, 0.6) * (1 + 0.15 * rng.standard_normal(3))
            surface = (1 + 0.15 * cloud(rng, clip.size, 0.1, 3))[..., None] * color
            scene = scene * (1 - mask[..., None]) + surface * mask[..., None]
            self.front = np.maximum(self.front, mask)
        self.light = shadow_bands(rng, clip)
        self.scene = np.asarray(np.clip(scene, 0.02, 1) * self.light[..., None], np.float32)
        noise = rng.standard_normal((height + NOISE_MARGIN, width + NOISE_MARGIN, 3)).astype(np.float32)
        # The sensor's mosaic makes neighbouring pixels share some of their noise.
        self.noise = 0.8 * noise + 0.6 * np.roll(noise, 1, 1)
        dt = 1 / clip.fps
        self.flicker = [self._flicker(patch, dt) for patch in clip.flicker]
        self.patches = [patch_of(mover, height) for mover in clip.movers]
        self.phases = rng.uniform(0, 2 * math.pi, 4)

    def frames(self) -> Iterator[Frame]:
        """Every frame `[H, W, 3]`, red, green and blue."""
        clip = self.clip
        automatic, usual = 0.0, float(self.scene.mean())
        blend = 1 - math.exp(-1 / (0.4 * clip.fps))
        for n in range(clip.frames):
            time = n / clip.fps
            image = self.scene.copy()
            for rows, columns, mask, course in self.flicker:
                image[rows, columns] *= 1 + mask * course[n]
            for mover, patch in zip(clip.movers, self.patches, strict=True):
                self._place(image, mover, patch, time)
            automatic += blend * (clip.reaction * math.log(usual / float(image[::4, ::4].mean())) - automatic)
            image *= np.exp(self._exposure(time) + automatic).astype(np.float32)
            top, left = self.rng.integers(0, NOISE_MARGIN, 2)
            height, width = clip.size
            image += np.float32(clip.noise) * self.noise[top : top + height, left : left + width]
            yield np.asarray(cv2.convertScaleAbs(np.maximum(image, 0, out=image), alpha=255.0), np.uint8)

    def _exposure(self, time: float) -> Floats:
        """Log gain of red, green and blue."""
        share, period, tint = self.clip.drift
        turn = 2 * math.pi * time / period
        gain = share * math.sin(turn + self.phases[0]) + tint * np.sin(turn * 0.7 + self.phases[1:])
        for start, size, tau in self.clip.steps:
            if time > start:
                gain = gain + size * (1 - math.exp(-(time - start) / tau))
        return np.asarray(gain, np.float32)

    def _flicker(self, patch: tuple[float, float, float, float, float], dt: float) -> tuple[Any, Any, Floats, Floats]:
        row, column, radius, strength, tau = patch
        height, width = self.clip.size
        rows, columns = (cells(c - 2 * radius, 4 * radius, height, e) for c, e in ((row, height), (column, width)))
        y = (np.arange(rows.start, rows.stop) / height - row)[:, None] / radius
        x = (np.arange(columns.start, columns.stop) / height - column) / radius
        mask = np.exp(-(y**2) - x**2).astype(np.float32)[..., None]
        return rows, columns, mask, strength * smooth_noise(self.rng, self.clip.frames, tau, dt)

    def _place(self, image: Floats, mover: Mover, patch: Floats, time: float) -> None:
        """Put an object, under what is in front of it and in the light of where it is."""
        height, width = self.clip.size
        row, column = mover.position(time)
        side = patch.shape[0]
        top, left = row * height - side / 2, column * height - side / 2
        y, x = math.floor(top), math.floor(left)
        rows, columns = slice(max(0, y), min(height, y + side)), slice(max(0, x), min(width, x + side))
        if rows.start >= rows.stop or columns.start >= columns.stop:
            return
        shift = np.array([[1, 0, left - x], [0, 1, top - y]], np.float64)
        moved = np.asarray(cv2.warpAffine(patch, shift, (side, side)), np.float32)
        moved = moved[rows.start - y : rows.stop - y, columns.start - x : columns.stop - x]
        under = image[rows, columns]
        free = (1 - self.front[rows, columns])[..., None]
        bright = 1 + mover.wobble * math.sin(2 * math.pi * mover.wobble_hz * time)
        under *= 1 - mover.shadow * moved[..., 4:5] * free
        alpha = moved[..., 3:4] * free
        under += (moved[..., :3] * (bright * self.light[rows, columns])[..., None] - under) * alpha


def cells(start: float, length: float, height: int, end: int) -> slice:
    """Pixels from `start` over `length` (heights of the frame), cut off at 0 and `end`."""
    first = min(max(0, round(start * height)), end)
    return slice(first, min(max(first, round((start + length) * height)), end))


def shadow_bands(rng: np.random.Generator, clip: Clip) -> Floats:
    """Light over the scene, `[H, W]`: 1, less in soft bands."""
    height, width = clip.size
    y, x = np.mgrid[0:height, 0:width].astype(np.float32) / height
    light = np.ones(clip.size, np.float32)
    for _ in range(clip.shade[0]):
        angle = rng.uniform(0, math.pi)
        along = y * math.sin(angle) + x * math.cos(angle)
        place, wide = rng.uniform(along.min(), along.max()), rng.uniform(0.05, 0.2)
        light *= 1 - np.float32(clip.shade[1]) * np.exp(-(np.abs((along - place) / wide) ** 4), dtype=np.float32)
    return light


def patch_of(mover: Mover, height: int) -> Floats:
    """An object's red, green, blue, outline and cast shadow, `[S, S, 5]`."""
    rng = np.random.default_rng(mover.seed)
    side = math.ceil(max(mover.size) * height * 1.8) + 4
    y, x = (np.mgrid[0:side, 0:side].astype(np.float32) - (side - 1) / 2) / height
    turn = math.radians(mover.tilt)
    v, u = y * math.cos(turn) - x * math.sin(turn), y * math.sin(turn) + x * math.cos(turn)
    power = 2 if mover.shape == "ellipse" else 8
    # The outline is scaled to the size's own axes whatever the tilt, and falls off over about a pixel.
    radius = (np.abs(v * 2 / mover.size[0]) ** power + np.abs(u * 2 / mover.size[1]) ** power) ** (1 / power)
    soft = 2.0 / (min(mover.size) * height)
    outline = np.clip((1 - radius) / soft + 0.5, 0, 1).astype(np.float32)
    light = 1 + mover.contrast * cloud(rng, (side, side), 0.15, 3)
    tint = 1 + 0.3 * mover.contrast * np.stack([cloud(rng, (side, side), 0.15, 2) for _ in range(3)], -1)
    color = np.clip(np.asarray(mover.color, np.float32) * light[..., None] * tint, 0, 1)
    blurred = np.asarray(cv2.GaussianBlur(outline, (0, 0), 0.03 * height), np.float32)
    offset = np.array([[1, 0, 0.04 * height], [0, 1, 0.05 * height]], np.float64)
    shadow = np.asarray(cv2.warpAffine(blurred, offset, (side, side)), np.float32)
    return np.concatenate([color, outline[..., None], shadow[..., None]], -1).astype(np.float32)
