"""Random dots by common fate: patches that nothing but their motion tells from the ground."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.arguments import check_number, is_finite
from ndtorch.errors import InputError
from ndtorch.scenes.base import RenderedScene, check_seed

Floats = npt.NDArray[np.float64]

GREY, CONTRAST = 0.5, 0.4
"""Mean light, and by how much a dot is lighter or darker."""
DOT = 2.0
"""Side of a dot, pixels."""
SMALLEST, LARGEST = 0.14, 0.19
"""Half of a patch's sides, as a share of the frame's height."""
MOST_DOTS = 1_000_000


@dataclass(frozen=True)
class DotPatch:
    """A patch of dots that moves as a whole.

    Attributes:
        middle: column and row of its center half-way through the scene, pixels.
        half: half its width and height, pixels.
        round: an ellipse; a rectangle otherwise.
        velocity: columns and rows a second.
    """

    middle: tuple[float, float]
    half: tuple[float, float]
    round: bool
    velocity: tuple[float, float]


class CommonFate(RenderedScene):
    """Light and dark dots on grey. In a single frame a patch cannot be seen: inside and outside dots are alike.

    The dots of the ground move at the patches' speed, each in its own direction; a share `ground` of them shares one.
    Of the dots in a patch a share `coherence` moves with the patch, the others are dots of the ground. A dot lives for
    `lifetime` seconds and then appears somewhere else. Later patches cover earlier ones. Everything is drawn from the
    seed: ellipses and rectangles, their places and directions of motion, at least 60° apart and `ground`'s too.

    Args:
        seconds, fps, size, device: see `RenderedScene`.
        patches: how many.
        density: dots a pixel.
        coherence: share of a patch's dots that move with it, 0 to 1.
        lifetime: of a dot, seconds; `inf` for dots that stay.
        speed: of patches and dots, pixels a second.
        ground: share of the ground's dots that move in one direction, 0 to 1.
        seed: of everything.

    Shapes:
        frames `[T, 3, H, W]` float32; `masks` `[T, patches, H, W]` bool.

    Raises:
        InputError: shares outside 0..1, a negative number, or what `RenderedScene` refuses.
    """

    def __init__(
        self,
        seconds: float = 3.0,
        fps: float = 25.0,
        size: tuple[int, int] = (144, 192),
        patches: int = 1,
        density: float = 0.02,
        coherence: float = 1.0,
        lifetime: float = 0.4,
        speed: float = 30.0,
        ground: float = 0.0,
        seed: int = 0,
        device: torch.device | str = "cpu",
    ) -> None:
        super().__init__("common-fate", seconds, fps, size, device)
        if not (isinstance(patches, int) and 0 <= patches <= 5):
            raise InputError(f"patches must be a number from 0 to 5, got {patches}")
        check_seed(seed)
        if np.min(seed) < 0:
            raise InputError(f"seed must be >= 0, got {repr(seed)[:40]}")
        check_number("density", density)
        if not 0 < density * self.size[0] * self.size[1] <= MOST_DOTS:
            raise InputError(f"density must be positive dots a pixel, {MOST_DOTS} dots at most, got {density}")
        for name, share in (("coherence", coherence), ("ground", ground)):
            if not (is_finite(share) and 0 <= share <= 1):
                raise InputError(f"{name} must be a share from 0 to 1, got {repr(share)[:40]}")
        check_number("lifetime", lifetime, above=0, unit="seconds", endless=True)
        check_number("speed", speed, least=0, unit="pixels a second")
        self.coherence, self.speed = coherence, speed
        rng = np.random.default_rng(seed)
        self.patches = draw_patches(rng, patches, self.size, speed, seconds)
        away = [math.atan2(-p.velocity[1], p.velocity[0]) for p in self.patches]
        common = opposite(rng, away)
        height, width = self.size
        life = self.length + 1 if math.isinf(lifetime) else max(1, round(lifetime * fps))
        area = (float(width), float(height))
        self._ground = Dots(rng, round(density * height * width), area, life, self.length)
        angle = np.where(self._ground.draw(rng) < ground, common, 2 * math.pi * self._ground.draw(rng))
        self._paces = speed * np.stack([np.cos(angle), -np.sin(angle)], -1) / fps
        self._keeps = self._ground.draw(rng) >= coherence
        self._layers = []
        for patch in self.patches:
            sides = (2 * patch.half[0], 2 * patch.half[1])
            self._layers.append(Dots(rng, round(density * coherence * sides[0] * sides[1]), sides, life, self.length))

    def centers(self, start: int, stop: int) -> Tensor:
        """Column and row of every patch's center in frames `start` to `stop - 1`, `[T, patches, 2]`."""
        time = (torch.arange(start, stop, dtype=torch.float64) - (self.length - 1) / 2) / self.fps
        middle = torch.tensor([patch.middle for patch in self.patches], dtype=torch.float64).reshape(-1, 2)
        pace = torch.tensor([patch.velocity for patch in self.patches], dtype=torch.float64).reshape(-1, 2)
        return middle + time[:, None, None] * pace

    def masks(self, start: int, stop: int) -> Tensor:
        """Which pixels show which patch in frames `start` to `stop - 1`, `[T, patches, H, W]` bool."""
        rows, columns = (np.arange(side, dtype=np.float64) for side in self.size)
        found = np.zeros((stop - start, len(self.patches), *self.size), dtype=bool)
        for t, centers in enumerate(self.centers(start, stop).numpy()):
            top = self._top(columns[None, :], rows[:, None], centers)
            for n in range(len(self.patches)):
                found[t, n] = top == n
        return torch.from_numpy(found)

    def frames(self, start: int, stop: int) -> Tensor:
        """Frames number `start` to `stop - 1`, `[T, 3, H, W]` float32 in 0..1."""
        out = [self._frame(n, self.centers(n, n + 1)[0].numpy()) for n in range(start, stop)]
        grey = torch.from_numpy(np.stack(out)) if out else torch.zeros(0, *self.size)
        return grey.unsqueeze(1).repeat(1, 3, 1, 1).to(self.device)

    def _top(self, x: Floats, y: Floats, centers: Floats) -> npt.NDArray[np.int64]:
        """The patch that covers each point, -1 for none."""
        top = np.full(np.broadcast(x, y).shape, -1)
        for n, (patch, center) in enumerate(zip(self.patches, centers, strict=True)):
            top[inside(patch, x - center[0], y - center[1])] = n
        return top

    def _frame(self, number: int, centers: Floats) -> npt.NDArray[np.float32]:
        place, which = self._ground.at(number)
        place = place + self._paces[which] * self._ground.age(number)[:, None]
        # The ground is a torus.
        place = (place + 0.5) % np.array(self.size[::-1]) - 0.5
        seen = (self._top(place[:, 0], place[:, 1], centers) < 0) | self._keeps[which]
        places, lights = [place[seen]], [self._ground.light[which][seen]]
        for n, (layer, patch) in enumerate(zip(self._layers, self.patches, strict=True)):
            place, which = layer.at(number)
            place = place - patch.half + centers[n]
            seen = self._top(place[:, 0], place[:, 1], centers) == n
            places.append(place[seen])
            lights.append(layer.light[which][seen])
        return splat(np.concatenate(places), np.concatenate(lights), self.size)


class Dots:
    """Places of dots that appear anew somewhere in an area after every lifetime.

    Args:
        rng: where they come from.
        count: dots at a time.
        area: width and height, pixels.
        life: frames that a dot lives.
        length: frames of the scene.
    """

    def __init__(self, rng: np.random.Generator, count: int, area: tuple[float, float], life: int, length: int) -> None:
        self.life, self.shape = life, ((length + life - 1) // life + 1, count)
        self.born = rng.integers(0, life, count)
        self.place = rng.random((*self.shape, 2)) * area
        self.light = np.where(rng.random(self.shape) < 0.5, -CONTRAST, CONTRAST)

    def draw(self, rng: np.random.Generator) -> Floats:
        """A number from 0 to 1 for every dot of every generation."""
        return rng.random(self.shape)

    def age(self, number: int) -> npt.NDArray[np.int64]:
        """Frames since each dot appeared."""
        age: npt.NDArray[np.int64] = (number + self.born) % self.life
        return age

    def at(self, number: int) -> tuple[Floats, tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]]:
        """Where the dots of a frame appeared, `[count, 2]`, and their indices into all."""
        which = ((number + self.born) // self.life, np.arange(self.shape[1]))
        return self.place[which], which


def inside(patch: DotPatch, x: Floats, y: Floats) -> npt.NDArray[np.bool_]:
    """Which points, given from its center, are of the patch."""
    u, v = x / patch.half[0], y / patch.half[1]
    within: npt.NDArray[np.bool_] = u * u + v * v < 1 if patch.round else np.maximum(abs(u), abs(v)) < 1
    return within


def draw_patches(
    rng: np.random.Generator, count: int, size: tuple[int, int], speed: float, seconds: float
) -> list[DotPatch]:
    """Patches whose ways stay in the frame where that is possible, apart half-way."""
    height, width = size
    found: list[DotPatch] = []
    ways: list[float] = []
    tries = 0
    while len(found) < count:
        tries += 1
        half = (height * rng.uniform(SMALLEST, LARGEST), height * rng.uniform(SMALLEST, LARGEST))
        way = rng.uniform(0, 2 * math.pi)
        velocity = (speed * math.cos(way), -speed * math.sin(way))
        reach = [half[n] + abs(velocity[n]) * seconds / 2 for n in (0, 1)]
        free = [max(side / 2 - r, 0.0) for side, r in zip((width, height), reach, strict=True)]
        middle = (width / 2 + free[0] * rng.uniform(-1, 1), height / 2 + free[1] * rng.uniform(-1, 1))
        near = any(math.dist(middle, other.middle) < max(half) + max(other.half) for other in found)
        alike = any(math.cos(way - other) > math.cos(math.pi / 3) for other in ways)
        # After many tries any place and way will do.
        if (near or alike) and tries < 200 * (len(found) + 1):
            continue
        found.append(DotPatch(middle, half, bool(rng.integers(2)), velocity))
        ways.append(way)
    return found


def opposite(rng: np.random.Generator, ways: list[float]) -> float:
    """A direction at least 60° from the others, where there is one."""
    way = 0.0
    for _ in range(200):
        way = rng.uniform(0, 2 * math.pi)
        if all(math.cos(way - other) < math.cos(math.pi / 3) for other in ways):
            break
    return way


def splat(places: Floats, lights: Floats, size: tuple[int, int]) -> npt.NDArray[np.float32]:
    """Dots on grey, with the same light at every sub-pixel place, `[H, W]`."""
    height, width = size
    first = np.floor(places - DOT / 2 + 0.5).astype(int)
    image = np.zeros(height * width)
    for down in range(round(DOT) + 1):
        for across in range(round(DOT) + 1):
            column, row = first[:, 0] + across, first[:, 1] + down
            share = covered(column - places[:, 0]) * covered(row - places[:, 1])
            there = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            flat = row[there] * width + column[there]
            image += np.bincount(flat, (lights * share)[there], height * width)
    light: npt.NDArray[np.float32] = (GREY + image.reshape(size)).clip(0, 1).astype(np.float32)
    return light


def covered(offset: Floats) -> Floats:
    """Share of a pixel at that offset from a dot's center that the dot covers, along one axis."""
    share: Floats = (DOT / 2 + 0.5 - np.abs(offset)).clip(0, 1)
    return share


common_fate = CommonFate
"""Random dots by their name among the scenes."""
