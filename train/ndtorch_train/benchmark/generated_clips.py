"""Generated video with known truth: what is drawn in a clip, by seed, and its frames.

Texture, light and shadow, occluders, a camera's exposure and noise; encoded as H.264.
"""

from __future__ import annotations

import colorsys
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError
from ndtorch.utils.files import replacing
from ndtorch_train.benchmark.base import Split
from ndtorch_train.benchmark.mot import Box, TrueBox, TrueFrame

Generator = np.random.Generator
Floats = npt.NDArray[np.float32]
Frame = npt.NDArray[np.uint8]

SECONDS = 8.0
SIZES: tuple[tuple[int, int], ...] = ((180, 320), (240, 424), (270, 480), (360, 640), (432, 768))
DIRECTIONS = ("left", "right", "down", "up")
HEADING = {"right": 0.0, "down": 90.0, "left": 180.0, "up": 270.0}
"""Degrees from rightward, clockwise as seen: rows count downward."""

SPLIT_SEEDS: dict[Split, int] = {"tune": 0, "test": 1_000_000}
"""First seed of each split; clips are numbered from there, and no split reaches the next."""

# Truth is sampled this often, and an object counts as seen while this much of it shows.
TRUTH_HZ = 10.0
SEEN = 0.5
SHORTEST_SIGHT = 1.2
# Noise is cut from one larger sheet at random places: fresh noise for every frame costs as much as the rest.
NOISE_MARGIN = 61


@dataclass(frozen=True)
class Mover:
    """One textured object on a straight path. Lengths in heights of the frame, times in seconds.

    Attributes:
        color: mean red, green and blue, 0..1.
        hue: of that color, degrees.
        direction: the main one of `DIRECTIONS`.
        shape: "ellipse" or "box" (rounded).
        size: height and width.
        tilt: degrees by which the outline is turned.
        velocity: down and to the right, heights a second.
        middle: where it is at time `at`.
        at: seconds.
        contrast: of its texture.
        shadow: strength of the soft shadow it casts, 0 for none.
        wobble: share by which its brightness swings; wobble_hz: how often.
        seed: of its texture.
    """

    color: tuple[float, float, float]
    hue: float
    direction: str
    shape: str
    size: tuple[float, float]
    tilt: float
    velocity: tuple[float, float]
    middle: tuple[float, float]
    at: float
    contrast: float
    shadow: float
    wobble: float
    wobble_hz: float
    seed: int

    def position(self, time: float) -> tuple[float, float]:
        """Row and column of its center, heights from the top left corner."""
        ahead = time - self.at
        return self.middle[0] + self.velocity[0] * ahead, self.middle[1] + self.velocity[1] * ahead


@dataclass(frozen=True)
class Clip:
    """All of one clip but the pixels: `Painter` draws the same frames from it every time.

    Attributes:
        count, fps, size, seconds, seed: number of objects, frames a second, height and width, length, seed.
        movers: the objects.
        occluders: row, column, height, width of things in front of them, heights.
        shade: number of soft shadow bands over the scene, and their strength.
        ground: mean color of the background.
        ground_contrast: of its texture.
        drift: slow swing of the exposure (share), its period, and the swing of each color by itself.
        steps: times, log gains and time constants of auto-exposure steps.
        reaction: how much the automatic exposure answers to the mean brightness, 0..1.
        flicker: row, column, radius (heights), strength and time constant of patches of flickering light.
        noise: standard deviation of the sensor's noise, share of full scale.
        quality: constant rate factor of the H.264 encoder (higher is worse).
    """

    count: int
    fps: float
    size: tuple[int, int]
    seconds: float
    seed: int
    movers: tuple[Mover, ...]
    occluders: tuple[tuple[float, float, float, float], ...]
    shade: tuple[int, float]
    ground: tuple[float, float, float]
    ground_contrast: float
    drift: tuple[float, float, float]
    steps: tuple[tuple[float, float, float], ...]
    reaction: float
    flicker: tuple[tuple[float, float, float, float, float], ...]
    noise: float
    quality: int

    @property
    def frames(self) -> int:
        """Number of frames."""
        return round(self.seconds * self.fps)

    @property
    def name(self) -> str:
        """A name fit for a file."""
        return f"clip-{self.seed}-{self.count}-{self.fps:g}"


def hsv(hue: float, saturation: float, value: float) -> tuple[float, float, float]:
    """Red, green and blue of a hue in degrees."""
    return colorsys.hsv_to_rgb((hue % 360) / 360, saturation, value)


def draw_clip(split: Split, number: int, count: int, fps: float, seconds: float = SECONDS) -> Clip:
    """Clip `number` of a split, with that many objects at that rate; the same arguments give the same clip."""
    seed = SPLIT_SEEDS[split] + number
    # Count and rate enter the seed, so that no two cells of the table show the same scenes.
    rng = np.random.default_rng([seed, count, round(fps * 10)])
    size = SIZES[rng.integers(len(SIZES))]
    width = size[1] / size[0]
    occluders = tuple(draw_occluder(rng, width) for _ in range(rng.integers(0, 3)))
    movers = draw_movers(rng, count, width, seconds, occluders)
    empty = count == 0
    return Clip(
        count=count,
        fps=fps,
        size=size,
        seconds=seconds,
        seed=seed,
        movers=movers,
        occluders=occluders,
        shade=(int(rng.integers(0, 4)), rng.uniform(0.2, 0.5)),
        ground=hsv(rng.uniform(0, 360), rng.uniform(0, 0.3), rng.uniform(0.25, 0.65)),
        ground_contrast=rng.uniform(0.04, 0.25),
        drift=(rng.uniform(0, 0.08), rng.uniform(4, 15), rng.uniform(0, 0.03)),
        steps=tuple(
            (rng.uniform(0.5, seconds - 0.5), rng.uniform(-0.22, 0.22), rng.uniform(0.05, 0.5))
            for _ in range(rng.integers(1 if empty else 0, 4 if empty else 3))
        ),
        reaction=rng.uniform(0, 0.7),
        flicker=tuple(
            (rng.uniform(0, 1), rng.uniform(0, width), rng.uniform(0.08, 0.25), rng.uniform(0.03, 0.2), t)
            for t in rng.uniform(0.1, 1.0, rng.integers(1 if empty else 0, 3))
        ),
        noise=rng.uniform(0.004, 0.02),
        quality=int(rng.integers(20, 31)),
    )


def draw_occluder(rng: Generator, width: float) -> tuple[float, float, float, float]:
    """A post or a hedge: row, column, height and width."""
    if rng.random() < 0.5:
        return (rng.uniform(-0.1, 0.3), rng.uniform(0.1, 0.9) * width, rng.uniform(0.5, 1.0), rng.uniform(0.05, 0.14))
    return (rng.uniform(0.1, 0.9), rng.uniform(0.0, 0.7) * width, rng.uniform(0.05, 0.14), rng.uniform(0.3, 0.8))


def draw_movers(
    rng: Generator, count: int, width: float, seconds: float, occluders: tuple[tuple[float, float, float, float], ...]
) -> tuple[Mover, ...]:
    """Objects that are seen long enough, differ in hue by 60 degrees, and do not travel on top of one another."""
    while True:
        first = rng.uniform(0, 360)
        gaps = rng.dirichlet(np.ones(count)) * (360 - 60 * count) if count else np.zeros(0)
        movers = tuple(draw_mover(rng, float(hue), width, seconds) for hue in first + np.cumsum(gaps + 60))
        if all(len(sight(m, width, seconds, occluders)) >= SHORTEST_SIGHT * TRUTH_HZ for m in movers) and apart(
            movers, width, seconds
        ):
            return movers


def draw_mover(rng: Generator, hue: float, width: float, seconds: float) -> Mover:
    """One object that crosses the image within 30 degrees of a main direction in 2.5 to 6 seconds."""
    direction = DIRECTIONS[rng.integers(4)]
    heading = math.radians(HEADING[direction] + rng.uniform(-30, 30))
    extent = width if direction in ("left", "right") else 1.0
    speed = extent / rng.uniform(2.5, 6.0)
    velocity = (speed * math.sin(heading), speed * math.cos(heading))
    size = (rng.uniform(0.12, 0.3), rng.uniform(0.12, 0.3))
    middle = (rng.uniform(0.25, 0.75), rng.uniform(0.25, 0.75) * width)
    reach = max(size) / 2
    # From the middle back to where it comes in.
    back = min(
        ((m + reach) / v if v > 0 else (m - e - reach) / v) if abs(v) > 1e-6 else math.inf
        for m, v, e in zip(middle, velocity, (1.0, width), strict=True)
    )
    enter = rng.uniform(0.6, 2.5) if rng.random() < 0.85 else rng.uniform(-2.0, 0.0)
    red, green, blue = hsv(hue, rng.uniform(0.5, 0.95), rng.uniform(0.4, 0.95))
    return Mover(
        color=(red, green, blue),
        hue=hue % 360,
        direction=direction,
        shape="ellipse" if rng.random() < 0.5 else "box",
        size=size,
        tilt=rng.uniform(0, 180),
        velocity=velocity,
        middle=middle,
        at=enter + back,
        contrast=rng.uniform(0.05, 0.3),
        shadow=rng.uniform(0.1, 0.45) if rng.random() < 0.5 else 0.0,
        wobble=rng.uniform(0, 0.2),
        wobble_hz=rng.uniform(0.3, 2.0),
        seed=int(rng.integers(1 << 31)),
    )


def shown(mover: Mover, time: float, width: float, occluders: tuple[tuple[float, float, float, float], ...]) -> float:
    """Share of an object's bounding box that is inside the image and not behind something."""
    row, column = mover.position(time)
    rows = row + mover.size[0] * np.linspace(-0.45, 0.45, 7)
    columns = column + mover.size[1] * np.linspace(-0.45, 0.45, 7)
    y, x = np.meshgrid(rows, columns, indexing="ij")
    seen = (y > 0) & (y < 1) & (x > 0) & (x < width)
    for top, left, height, wide in occluders:
        seen &= ~((y > top) & (y < top + height) & (x > left) & (x < left + wide))
    return float(seen.mean())


def sight(
    mover: Mover, width: float, seconds: float, occluders: tuple[tuple[float, float, float, float], ...]
) -> list[float]:
    """The times, `TRUTH_HZ` a second, at which at least half of an object shows."""
    times = np.arange(round(seconds * TRUTH_HZ)) / TRUTH_HZ
    return [float(t) for t in times if shown(mover, float(t), width, occluders) >= SEEN]


def apart(movers: tuple[Mover, ...], width: float, seconds: float) -> bool:
    """Whether every two objects are a third of the image's height apart for half of the time both are there."""
    for i, one in enumerate(movers):
        for other in movers[:i]:
            both = set(sight(one, width, seconds, ())) & set(sight(other, width, seconds, ()))
            near = [t for t in both if math.dist(one.position(t), other.position(t)) < 1 / 3]
            if len(near) > len(both) / 2:
                return False
    return True


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


def bounding_box(mover: Mover, time: float, height: int) -> Box:
    """The box of an object's tilted outline, pixels."""
    row, column = mover.position(time)
    sine, cosine = abs(math.sin(math.radians(mover.tilt))), abs(math.cos(math.radians(mover.tilt)))
    tall, wide = mover.size[0] * cosine, mover.size[0] * sine
    add = math.hypot if mover.shape == "ellipse" else lambda a, b: a + b
    down, across = add(tall, mover.size[1] * sine) / 2, add(mover.size[1] * cosine, wide) / 2
    return Box(*(height * side for side in (column - across, row - down, column + across, row + down)))


def boxes_of(clip: Clip) -> Iterator[TrueFrame]:
    """The truth, frame by frame: the boxes of the objects of which at least `SEEN` shows."""
    height, width = clip.size[0], clip.size[1] / clip.size[0]
    for n in range(clip.frames):
        time = n / clip.fps
        there = [k for k, one in enumerate(clip.movers) if shown(one, time, width, clip.occluders) >= SEEN]
        yield TrueFrame([TrueBox(k, bounding_box(clip.movers[k], time, height)) for k in there])


def clip_file(clip: Clip, folder: Path) -> Path:
    """The clip as a video file in `folder`, encoded unless it is there already."""
    path = folder / f"{clip.name}.mp4"
    if not path.exists():
        with replacing(path) as part:
            encode(Painter(clip).frames(), part, clip.fps, clip.size, clip.quality)
    return path


def encode(frames: Iterable[Frame], path: Path, fps: float, size: tuple[int, int], quality: int) -> None:
    """Write frames `[H, W, 3]` (red, green, blue) as H.264 with a constant rate factor."""
    try:
        container: Any = av.open(str(path), "w")
    except OSError as error:
        raise InputError(f"video {path} cannot be written: {error}") from None
    with container:
        stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000))
        stream.height, stream.width, stream.pix_fmt = *size, "yuv420p"
        stream.options = {"crf": str(quality), "preset": "veryfast", "threads": "1"}
        for frame in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        container.mux(stream.encode())
