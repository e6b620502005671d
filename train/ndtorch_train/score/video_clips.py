"""Generated video with known truth: what is drawn in a clip, by seed; `video_paint` draws it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ndtorch_train.score.choices import Split

Generator = np.random.Generator

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
    import colorsys

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
    """One object that crosses the picture within 30 degrees of a main direction in 2.5 to 6 seconds."""
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
    """Share of an object's bounding box that is inside the picture and not behind something."""
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
    """Whether every two objects are a third of the picture's height apart for half of the time both are there."""
    for i, one in enumerate(movers):
        for other in movers[:i]:
            both = set(sight(one, width, seconds, ())) & set(sight(other, width, seconds, ()))
            near = [t for t in both if math.dist(one.position(t), other.position(t)) < 1 / 3]
            if len(near) > len(both) / 2:
                return False
    return True


def truth(clip: Clip) -> dict[str, Any]:
    """What a clip shows, as plain data: every object's color, main direction, and when and where it is seen.

    Places are row and column as shares of the height and width of the frame.
    """
    width = clip.size[1] / clip.size[0]
    objects = []
    for mover in clip.movers:
        times = sight(mover, width, clip.seconds, clip.occluders)
        places = [mover.position(t) for t in times]
        objects.append(
            {
                "color": [round(c, 3) for c in mover.color],
                "direction": mover.direction,
                "times": [round(t, 2) for t in times],
                "places": [[round(y, 3), round(x / width, 3)] for y, x in places],
            }
        )
    samples = np.arange(round(clip.seconds * TRUTH_HZ)) / TRUTH_HZ
    seen = [sum(round(float(t), 2) in thing["times"] for thing in objects) for t in samples]
    return {
        "seed": clip.seed,
        "fps": clip.fps,
        "size": list(clip.size),
        "seconds": clip.seconds,
        "count": clip.count,
        "count_over_time": seen,
        "objects": objects,
    }
