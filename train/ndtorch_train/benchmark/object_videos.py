"""`ndtorch benchmark object-videos`: masks and identities of objects in short videos, by others' protocol.

The protocol is that of the object-centric representation benchmark (Weis et al., JMLR 22(183), 2021): 64 x 64 pixels,
ten frames, the first two not scored, CLEAR MOT on masks. Videos are drawn after its descriptions, or read from `.npz`
files with `frames` `[V, T, H, W, 3]` and `masks` `[V, T, H, W]`, both uint8.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from ndtorch.errors import InputError
from ndtorch.tracking.layers import Layers
from ndtorch.tracking.regions import color_parts, commonest_color
from ndtorch.utils.files import ARRAY_BYTES, check_declared, open_regular
from ndtorch_train.benchmark.base import Benchmark, Column, Split, Task, known
from ndtorch_train.benchmark.mot import mask_iou
from ndtorch_train.rows import Row

Frames = npt.NDArray[np.uint8]
Masks = npt.NDArray[Any]
Floats = npt.NDArray[np.float64]

SIZE, FRAMES = 64, 10
WARM_UP = 2
"""Frames that are not scored."""
FIRST_SEED = {"tune": 30_000_000, "test": 31_000_000}
"""Video i of a set has this seed plus i."""
PURE = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0], [255, 0, 255], [0, 255, 255]], np.float32)


def noise(rng: np.random.Generator, size: int, exponent: float) -> Floats:
    """An image whose amplitude falls with this power of frequency, of unit variance."""
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.fftfreq(size)[None])
    frequency[0, 0] = 1
    image = np.fft.ifft2(np.fft.fft2(rng.standard_normal((size, size))) * frequency**-exponent).real
    return np.asarray((image - image.mean()) / image.std())


def texture(rng: np.random.Generator, size: int = 2 * SIZE) -> npt.NDArray[np.float32]:
    """A colored texture `[size, size, 3]`: 1/f noise, blotches of two colors, or a gradient with grain."""
    kind = rng.integers(3)
    if kind == 0:
        exponent = rng.uniform(0.3, 1.6)
        shared = noise(rng, size, exponent)
        layers = [rng.uniform(0.3, 1) * shared + rng.uniform(0, 0.5) * noise(rng, size, exponent) for _ in range(3)]
        image = rng.uniform(60, 190, 3) + np.stack(layers, -1) * rng.uniform(10, 45)
    elif kind == 1:
        steep = (noise(rng, size, rng.uniform(1, 2)) - rng.uniform(-0.5, 0.5)) * rng.uniform(1, 6)
        share = np.clip(steep + 0.5, 0, 1)[..., None]
        image = rng.uniform(0, 255, 3) * share + rng.uniform(0, 255, 3) * (1 - share)
        image = image + noise(rng, size, 0.8)[..., None] * rng.uniform(0, 10)
    else:
        rows, columns = np.mgrid[:size, :size] / size
        slope = (rows * rng.uniform(-1, 1) + columns * rng.uniform(-1, 1))[..., None] * rng.uniform(-150, 150, 3)
        image = rng.uniform(30, 220, 3) + slope + noise(rng, size, 1.5)[..., None] * rng.uniform(1, 12)
    return np.clip(image, 0, 255).astype(np.float32)


def plain(color: Any, size: int = 2 * SIZE) -> npt.NDArray[np.float32]:
    """An image of one color."""
    return np.broadcast_to(np.asarray(color, np.float32), (size, size, 3)).copy()


SHAPES: tuple[Callable[[Floats, Floats], Any], ...] = (
    lambda u, v: (np.abs(u) <= 1) & (np.abs(v) <= 1),
    lambda u, v: u**2 + (v / 0.6) ** 2 <= 1,
    lambda u, v: ((1.2 * u) ** 2 + (0.1 - 1.2 * v) ** 2 - 0.8) ** 3 <= 1.5 * (1.2 * u) ** 2 * (0.1 - 1.2 * v) ** 3,
    lambda u, v: u**2 + v**2 <= 1,
    lambda u, v: np.abs(u) + np.abs(v) <= 1,
    lambda u, v: (v <= 0.8) & (v >= 2 * np.abs(u) - 1),
)
"""Square, ellipse, heart, disc, diamond and triangle, in coordinates from -1 to 1."""


class Body(NamedTuple):
    """One object of a video: its places `[T, 2]`, shape, half its length, turn, and image."""

    path: Floats
    shape: int
    half: float
    turn: float
    image: npt.NDArray[np.float32]


def drawn(ground: npt.NDArray[np.float32], bodies: Sequence[Body]) -> tuple[Frames, Frames]:
    """Frames and masks; later bodies hide earlier ones."""
    rows, columns = np.mgrid[:SIZE, :SIZE].astype(np.float32)
    frames = np.empty((FRAMES, SIZE, SIZE, 3), np.uint8)
    masks = np.zeros((FRAMES, SIZE, SIZE), np.uint8)
    for t in range(FRAMES):
        image = ground[:SIZE, :SIZE].copy()
        for number, body in enumerate(bodies, start=1):
            y, x = rows - body.path[t, 0], columns - body.path[t, 1]
            cos, sin = np.cos(body.turn), np.sin(body.turn)
            inside = SHAPES[body.shape]((x * cos + y * sin) / body.half, (y * cos - x * sin) / body.half)
            across, down = (x + SIZE).astype(np.float32), (y + SIZE).astype(np.float32)
            turned = cv2.remap(body.image, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
            image[inside] = turned[inside]
            masks[t][inside] = number
        frames[t] = np.clip(image + 0.5, 0, 255)
    return frames, masks


def vmds(rng: np.random.Generator, textured: bool = False) -> tuple[Frames, Frames]:
    """One to four squares, ellipses and hearts of 8 to 21 pixels, on bent paths at .5 to 3.5 pixels a frame."""

    def look() -> npt.NDArray[np.float32]:
        return texture(rng) if textured else plain(rng.integers(0, 256, 3))

    ground, bodies = look(), list[Body]()
    for _ in range(rng.integers(1, 5)):
        while True:
            direction = rng.uniform(0, 2 * np.pi) + rng.uniform(-0.25, 0.25) * np.arange(FRAMES)
            steps = rng.uniform(0.5, 3.5) * np.stack([np.sin(direction), np.cos(direction)], -1)
            path = rng.uniform(8, SIZE - 8, 2) + np.cumsum(steps, 0)
            if path.min() > 6 and path.max() < SIZE - 6:
                break
        bodies.append(Body(path, int(rng.integers(3)), rng.uniform(4, 10.5), rng.uniform(0, 2 * np.pi), look()))
    return drawn(ground, bodies)


def spmot(rng: np.random.Generator) -> tuple[Frames, Frames]:
    """Discs, squares, diamonds and triangles of pure colors on black, 10 pixels, that come and go at 2.65 a frame."""
    bodies = []
    for _ in range(3):
        direction = rng.uniform(0, 2 * np.pi)
        step = 2.65 * np.array([np.sin(direction), np.cos(direction)])
        path = rng.uniform(0, SIZE, 2) + np.outer(np.arange(FRAMES) - rng.integers(FRAMES), step)
        bodies.append(Body(path, int(rng.choice([0, 3, 4, 5])), 5.0, 0.0, plain(rng.choice(PURE))))
    return drawn(plain(0), bodies)


SETS: Mapping[str, Callable[[np.random.Generator], tuple[Frames, Frames]]] = {
    "spmot": spmot,
    "vmds": vmds,
    "texvmds": functools.partial(vmds, textured=True),
}
"""Sets by the names of the benchmark."""


def layers(frames: Frames) -> Masks:
    """Labels by `ndtorch.tracking.layers`."""
    return Layers()(frames)[0]


def color_tracker(frames: Frames) -> Masks:
    """Connected parts of one color on the commonest, linked by the Hungarian method: the peer."""
    labels, before, count = np.zeros(frames.shape[:3], np.int32), np.zeros((0, 5)), 0
    ids = np.zeros(0, int)
    for t, frame in enumerate(frames.astype(np.int32)):
        color = commonest_color(frame, 0.0)
        parts = color_parts(frame, 0, (frame != color).any(-1))
        kept = [n for n, area in enumerate(np.bincount(parts.ravel())) if n and area > 5]
        now = np.array([[*np.argwhere(parts == n).mean(0), *frame[parts == n].mean(0)] for n in kept]).reshape(-1, 5)
        apart = np.linalg.norm(before[:, None, :2] - now[None, :, :2], axis=-1)
        apart = apart + np.linalg.norm(before[:, None, 2:] - now[None, :, 2:], axis=-1)
        numbers = np.zeros(len(now), int)
        for a, b in zip(*linear_sum_assignment(apart), strict=True):
            numbers[b] = ids[a] if apart[a, b] < 16 else 0
        for b, part in enumerate(kept):
            if not numbers[b]:
                count += 1
                numbers[b] = count
            labels[t][parts == part] = numbers[b]
        before, ids = now, numbers
    return labels


METHODS: Mapping[str, Callable[[Frames], Masks]] = {"layers": layers, "colors": color_tracker}
"""Every method by its name."""


class MaskScore(NamedTuple):
    """Counts over all frames of some videos; `overlap` is the sum of the IoU of all pairs."""

    objects: int = 0
    pairs: int = 0
    misses: int = 0
    false_positives: int = 0
    switches: int = 0
    overlap: float = 0.0

    @property
    def mota(self) -> float:
        """Multiple object tracking accuracy."""
        return 1 - (self.misses + self.false_positives + self.switches) / max(1, self.objects)

    @property
    def motp(self) -> float:
        """Mean IoU of all pairs."""
        return self.overlap / max(1, self.pairs)

    def plus(self, other: MaskScore) -> MaskScore:
        """The counts of both."""
        return MaskScore(*(a + b for a, b in zip(self, other, strict=True)))  # type: ignore[arg-type]


def clear_mot(truth: Masks, found: Masks) -> MaskScore:
    """CLEAR MOT on masks of one video, both `[T, H, W]` with 0 for the ground, by the rules of the benchmark.

    Masks of 5 pixels or fewer are left out, and found ones that overlap the ground by an IoU above .2. A true object
    keeps its partner while their IoU is at least .5; the others are matched for most pairs, then for the best overlap.
    """
    total, partners = MaskScore(), dict[int, int]()
    for true, seen in zip(truth[WARM_UP:], found[WARM_UP:], strict=True):
        objects, masks = _large(true), _large(seen)
        masks = [m for m in masks if mask_iou(m[1], true == 0) <= 0.2]
        overlap = np.array([[mask_iou(a, b) for _, b in masks] for _, a in objects]).reshape(len(objects), len(masks))
        kept = {label: j for j, (label, _) in enumerate(masks)}
        pairs: dict[int, int] = {}
        for i, (label, _) in enumerate(objects):
            j = kept.get(partners.get(label, -1), -1)
            if j >= 0 and overlap[i, j] >= 0.5:
                pairs[i] = j
        gain = np.where(overlap >= 0.5, 1 + 1e-3 * overlap, 0)
        gain[list(pairs)] = 0
        gain[:, list(pairs.values())] = 0
        pairs |= {int(i): int(j) for i, j in zip(*linear_sum_assignment(-gain), strict=True) if gain[i, j] > 0}
        switches = 0
        for i, j in pairs.items():
            label, partner = objects[i][0], masks[j][0]
            switches += partners.get(label, partner) != partner
            partners[label] = partner
        n = len(pairs)
        shared = sum(overlap[i, j] for i, j in pairs.items())
        total = total.plus(MaskScore(len(objects), n, len(objects) - n, len(masks) - n, switches, shared))
    return total


def _large(labels: Masks) -> list[tuple[int, npt.NDArray[np.bool_]]]:
    return [(int(n), labels == n) for n in np.unique(labels) if n and (labels == n).sum() > 5]


def videos(case: str, folder: Path | None, split: Split, count: int) -> list[tuple[Frames, Masks]]:
    """The videos of a set, drawn, or read from `CASE.npz` in a folder."""
    if folder is None:
        return [SETS[case](np.random.default_rng(FIRST_SEED[split] + n)) for n in range(count)]
    path = folder / f"{case}.npz"
    with open_regular(path, ARRAY_BYTES) as opened:
        check_declared(path, opened)
        with np.load(opened, allow_pickle=False) as file:
            frames, masks = file.get("frames"), file.get("masks")
    if frames is None or masks is None or frames.dtype != np.uint8 or frames.shape[:4] != masks.shape:
        raise InputError(f"{path} needs frames [V, T, H, W, 3] uint8 and masks [V, T, H, W]")
    return list(zip(frames, masks, strict=True))[:count]


def measure(case: str, method: str, folder: Path | None, split: Split, count: int, out: Path) -> list[Row]:
    """The row of a method on a set; all videos go into one count."""
    total = MaskScore()
    for frames, masks in videos(case, folder, split, count):
        total = total.plus(clear_mot(masks, METHODS[method](frames)))
    n = max(1, total.objects)
    return [
        {
            "case": case, "method": method, "mota": total.mota, "motp": total.motp, "misses": total.misses / n,
            "false_positives": total.false_positives / n, "switches": total.switches / n, "objects": total.objects,
        }
    ]  # fmt: skip


COLUMNS = (
    Column("case", "set"),
    Column("method", "method"),
    Column("mota", "MOTA", 3, better=1),
    Column("motp", "MOTP", 3, better=1),
    Column("misses", "misses", 3, better=-1),
    Column("false_positives", "false positives", 3, better=-1),
    Column("switches", "switches", 3, better=-1),
    Column("objects", "objects"),
)


def object_video_benchmark(
    folder: Path | None, methods: Sequence[str], sets: Sequence[str], count: int, split: Split
) -> Benchmark:
    """The benchmark of some methods on some sets."""
    known("methods", methods, list(METHODS))
    known("sets", sets, list(SETS))
    if not 1 <= count <= 10_000:
        raise InputError(f"videos must be between 1 and 10000, got {count}")
    if folder is not None and not folder.is_dir():
        raise InputError(f"{folder} is not a folder")
    tasks = [
        Task(f"{case}, {method}", functools.partial(measure, case, method, folder, split, count))
        for case in sets
        for method in methods
    ]
    source = f"split {split}" if folder is None else f"read from {folder.name}"
    note = f"{count} videos a set at most, {source}. Ratios to the number of true objects, CLEAR MOT on masks."
    settings = {"split": split, "videos": count, "folder": str(folder)}
    return Benchmark(
        "object-videos", "Objects in short videos", note, COLUMNS, tasks, ("ndtorch.tracking",), settings=settings
    )
