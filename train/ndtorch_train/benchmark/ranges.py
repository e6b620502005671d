"""`ndtorch benchmark ranges`: ranges of single rows on images of real stereo cameras, beside OpenCV's matching.

Stereo pairs with the true disparity of every left pixel, under conditions that real cameras add.
"""

from __future__ import annotations

import functools
import platform
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import FeatureParams, MatchParams, StereoRanging, StereoRig
from ndtorch.navigation.stereo.search import SearchParams
from ndtorch.report.page import Shown
from ndtorch_train.benchmark.base import Benchmark, Column, Row, Task
from ndtorch_train.plots import draw_ranges

Image = npt.NDArray[np.uint8]
Disparity = npt.NDArray[np.float32]
Floats = npt.NDArray[np.float64]

KITTI = 256.0
"""A pixel of disparity in files of 16 bits whose name has no other scale."""
EVERY, MARGIN = 3, 3
"""Every so many rows of an image are taken for the horizon row, but none so near its border."""

BLOCK = 5
"""Pixels across what `cv2.StereoSGBM` compares; its other numbers are those of OpenCV's example."""
PUBLISHED, SEARCH, SGBM = "features", "search", "SGBM"

COLUMNS = (
    Column("case", "pair, condition"),
    Column("method", "method"),
    Column("per_row", "a row", 1),
    Column("known_per_row", "with truth", 1),
    Column("within_1", "1 px", 3, better=1),
    Column("within_2", "2 px", 3, better=1),
    Column("within_10", "10 %", 3, better=1),
    Column("ms", "ms"),
    Column("of_sgbm", "of SGBM's time", 3),
)

NOTE = (
    "Every {every}rd row of an image is taken for the horizon row; disparities {low} to {high}. `features` is the "
    "published matching, `search` is `--stereo search`, both as the navigator runs them; SGBM is `cv2.StereoSGBM` on "
    "the whole image, read at the pixels of `search` where it has a disparity. Ratios are of the ranges whose truth is "
    "known. Time: processor time of one row (median), of SGBM of one image, one thread; {machine}, torch {torch}."
)


def range_benchmark(place: Path, disparities: tuple[int, int]) -> Benchmark:
    """The benchmark on every pair of a folder."""
    low, high = disparities
    if not 1 <= low < high - 1 or high > 1024:
        raise InputError(f"disparities must be two numbers 1 <= LEAST < LARGEST - 1 < 1024, got {low} {high}")
    tasks, images = list[Task](), list[tuple[str, str]]()
    for number, folder in enumerate(pair_folders(place)):
        pair = read_pair(folder, number)
        if pair.left.shape[1] < least_columns(high):
            raise InputError(f"{pair.name}: {pair.left.shape[1]} columns are too few for disparities up to {high}")
        tasks.append(Task(pair.name, functools.partial(measure, folder, number, disparities)))
        images.append((f"pair-{number:03d}.png", pair.name))
    note = NOTE.format(every=EVERY, low=low, high=high, machine=platform.machine(), torch=torch.__version__)

    def shown(rows: list[Row], out: Path) -> list[Shown]:
        words = "Ranges of the search: blue right to 10 %, orange not, grey unknown."
        return [Shown(out / file, name, words) for file, name in images]

    return Benchmark(
        "ranges",
        "Ranges on real stereo images",
        note,
        COLUMNS,
        tasks,
        mean_rows,
        shown,
        settings={"disparities": disparities, "pairs": str(place.resolve())},
    )


def measure(place: Path, number: int, disparities: tuple[int, int], folder: Path) -> list[Row]:
    """Rows of all methods on a pair under all conditions; an image of what the search finds in the pair as it is."""
    pair = read_pair(place, number)
    height, width = pair.left.shape
    modules = {name: ranging(width, height, disparities, name == SEARCH) for name in (PUBLISHED, SEARCH)}
    for module in modules.values():
        by_rows(module, [(pair.left[:12], pair.right[:12])] * 2)  # compiles what has to be, before the time is taken
    rows: list[Row] = []
    for condition in CONDITIONS:
        views = condition.views(pair, 2, seed=0)
        wide = semi_global(*views[1], disparities[1])
        found = {name: by_rows(module, views) for name, module in modules.items()}
        if not rows:
            draw_pair(pair, found[SEARCH], folder / f"pair-{number:03d}.png")
        found[SGBM] = wide.at(found[SEARCH])
        for name, one in found.items():
            times = {"ms": 1e3 * one.seconds, "of_sgbm": one.seconds / max(wide.seconds, 1e-9)}
            case = {"case": f"{pair.name}, {condition.name}", "condition": condition.name, "number": number}
            rows.append({**case, "method": name, **judge(one, pair.truth), **times})
    return rows


def draw_pair(pair: Pair, found: Found, path: Path) -> None:
    """Where ranges were found in the left image, and which are right to 10 %."""
    true = pair.truth[found.row, found.column]
    right = np.abs(true / found.disparity - 1) <= 0.1
    kinds = {"unknown": true <= 0, "right": (true > 0) & right, "wrong": (true > 0) & ~right}
    draw_ranges(pair.left, found.row, found.column, kinds, path)


def judge(found: Found, truth: Disparity) -> Row:
    """Ranges a row, those with truth, and the ratios of disparities right to 1 px, to 2 px, and of ranges to 10 %."""
    true = truth[found.row, found.column].astype(np.float64)
    there = true > 0
    measured, true = found.disparity[there], true[there]
    off, far = np.abs(measured - true), np.abs(true / measured - 1)
    ratios = [float(np.mean(good)) if len(true) else None for good in (off <= 1, off <= 2, far <= 0.1)]
    counts = len(found.row) / max(found.rows, 1), len(true) / max(found.rows, 1)
    names = ("per_row", "known_per_row", "within_1", "within_2", "within_10")
    return dict(zip(names, (*counts, *ratios), strict=True))


def mean_rows(rows: list[Row]) -> list[Row]:
    """Over all pairs of even number, over all of odd number, and over all, every pair alike."""
    found = []
    for name, chosen in (("even pairs", {0}), ("odd pairs", {1}), ("all pairs", {0, 1})):
        for condition, method in dict.fromkeys((row["condition"], row["method"]) for row in rows):
            mine = [
                r for r in rows if (r["condition"], r["method"]) == (condition, method) and r["number"] % 2 in chosen
            ]
            if len({row["number"] for row in mine}) > 1 or (mine and name == "all pairs"):
                values = {c.key: [v for row in mine if (v := row[c.key]) is not None] for c in COLUMNS[2:]}
                means = {key: float(np.mean(each)) if each else None for key, each in values.items()}
                found.append({"case": f"{name}, {condition}", "method": method, **means})
    return found


@dataclass(frozen=True)
class Pair:
    """A rectified pair.

    Attributes:
        name: of its folder.
        number: of it in its folder, from 0.
        left, right: grey, `[H, W]`.
        truth: disparity of the left pixels, `[H, W]`; 0 where it is not known.
    """

    name: str
    number: int
    left: Image
    right: Image
    truth: Disparity


def pair_folders(folder: Path) -> list[Path]:
    """The folders that hold a left.png, sorted by name; the folder itself if it does."""
    pairs = [folder] if (folder / "left.png").is_file() else sorted(path.parent for path in folder.glob("*/left.png"))
    if not pairs:
        raise InputError(f"{folder} holds no pairs: expected folders with left.png, right.png and disp*.png or .tif")
    return pairs


def read_pair(folder: Path, number: int = 0) -> Pair:
    """Read left.png, right.png, and the truth: the one file whose name begins with `disp`.

    Its values are pixels in files of floating point (.tif, .pfm), pixels times N where its name ends in `_xN`, and
    otherwise pixels times 256, as KITTI has them. What is 0, negative or not finite is not known.
    """
    left, right = read_grey(folder / "left.png"), read_grey(folder / "right.png")
    truths = sorted(path for path in folder.glob("disp*") if path.suffix in (".png", ".tif", ".tiff", ".pfm"))
    if len(truths) != 1:
        raise InputError(f"{folder} must hold one file disp*.png, .tif or .pfm, found {len(truths)}")
    truth = np.asarray(read(truths[0], color=False), np.float32)
    if not left.shape == right.shape == truth.shape:
        raise InputError(f"{folder}: the sizes differ: left {left.shape}, right {right.shape}, truth {truth.shape}")
    scale = re.search(r"_x(\d+)$", truths[0].stem)
    if scale is not None:
        truth = truth / float(scale[1])
    elif truths[0].suffix == ".png":
        truth = truth / KITTI
    known = np.isfinite(truth) & (truth > 0)
    return Pair(folder.name, number, left, right, np.where(known, truth, 0).astype(np.float32))


def read_grey(path: Path) -> Image:
    """An image in grey."""
    return np.asarray(read(path, color=True), np.uint8)


def read(path: Path, color: bool) -> npt.NDArray[Any]:
    """A file as an array; made grey where it is an image in color."""
    logging: Any = cv2.utils.logging
    before = logging.getLogLevel()
    try:
        logging.setLogLevel(logging.LOG_LEVEL_ERROR)  # tags of maps in TIFF files are no matter here
        found = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE if color else cv2.IMREAD_UNCHANGED)
    finally:
        logging.setLogLevel(before)
    if found is None or found.ndim != 2:
        raise InputError(f"{path} cannot be read as an image in grey")
    return found


@dataclass(frozen=True)
class Condition:
    """What is done to a pair: noise of so many levels of 1, and the right image so many times as bright."""

    name: str
    noise: float = 0.0
    exposure: float = 1.0

    def views(self, pair: Pair, frames: int, seed: int) -> list[tuple[Image, Image]]:
        """The pair so many times, each with its own noise."""
        rng = np.random.default_rng((seed, pair.number))
        return [(self.one(pair.left, 1.0, rng), self.one(pair.right, self.exposure, rng)) for _ in range(frames)]

    def one(self, image: Image, factor: float, rng: np.random.Generator) -> Image:
        """One image."""
        values = image * np.float32(factor)
        if self.noise:
            values = values + rng.normal(0, 255 * self.noise, image.shape)
        return np.asarray(values.round().clip(0, 255), np.uint8)


CONDITIONS = (
    Condition("as it is"),
    Condition("noise 1 %", noise=0.01),
    Condition("right 10 % brighter", exposure=1.1),
    Condition("right 10 % darker, noise 1 %", noise=0.01, exposure=0.9),
)


class Found(NamedTuple):
    """Disparities of an image.

    Attributes:
        row, column: of the left pixels, `[n]`.
        disparity: `[n]`.
        rows: how many rows were looked at.
        seconds: processor time of one row, or of the whole image where that is done at once.
    """

    row: npt.NDArray[np.int64]
    column: npt.NDArray[np.int64]
    disparity: Floats
    rows: int
    seconds: float


def scanned_rows(height: int) -> range:
    """The rows of an image that are taken for the horizon row, one after the other."""
    return range(MARGIN, height - MARGIN, EVERY)


def ranging(width: int, height: int, disparities: tuple[int, int], search: bool) -> StereoRanging:
    """The navigator's ranging for images of a size; the rig's lengths do not matter for disparities."""
    rig, (low, high) = StereoRig(width=width, height=height, focal=float(width)), disparities
    if search:
        return StereoRanging(rig, 1 / 30, search=SearchParams(min_disparity_px=low, max_disparity_px=high))
    return StereoRanging(rig, 1 / 30, FeatureParams(), MatchParams(low, high))


def by_rows(module: StereoRanging, views: list[tuple[Image, Image]]) -> Found:
    """Range every few rows.

    Args:
        module: of `ranging`.
        views: the pair twice. The first is shown moved by one pixel, so that everything moves by that between the two
            frames, as when the car turns: what does not move has no features.
    """
    around = module.row.bottom - module.row.top
    found: list[tuple[int, Floats, Floats]] = []
    seconds, rows = [], scanned_rows(views[0][0].shape[0])
    with torch.inference_mode():
        for y in rows:
            before, now = (strips(view, y, around, moved) for view, moved in zip(views, (1, 0), strict=True))
            _, state = module(*before)
            began = time.process_time()
            ranges, _ = module(*now, state)
            seconds.append(time.process_time() - began)
            good = ranges.valid[-1]
            left, right = (
                module.rig.center[0] - module.rig.focal * angle[-1][good].double().tan().numpy()
                for angle in (ranges.left_angle, ranges.right_angle)
            )
            found.append((y, left, left - right))
    counts = [len(left) for _, left, _ in found]
    column = np.concatenate([left for _, left, _ in found]).round().astype(np.int64)
    return Found(
        np.repeat(np.array(rows), counts),
        column,
        np.concatenate([disparity for *_, disparity in found]),
        len(rows),
        float(np.median(seconds)),
    )


def strips(view: tuple[Image, Image], y: int, around: int, moved: int) -> Iterator[torch.Tensor]:
    """Rows `[1, 1, around, W]` of both images, moved by so many pixels to the left."""
    for image in view:
        rows = np.roll(image[y - around // 2 : y + around // 2 + 1], -moved, 1)
        yield torch.from_numpy(np.ascontiguousarray(rows))[None, None]


class SemiGlobal(NamedTuple):
    """Disparities `[H, W]` by `cv2.StereoSGBM` (not above 0 where it finds none), and its processor time."""

    disparity: Disparity
    seconds: float

    def at(self, found: Found) -> Found:
        """Its disparities at the pixels that others found."""
        measured = self.disparity[found.row, found.column]
        known = measured > 0
        return Found(
            found.row[known], found.column[known], measured[known].astype(np.float64), found.rows, self.seconds
        )


def semi_global(left: Image, right: Image, most: int) -> SemiGlobal:
    """`cv2.StereoSGBM` on whole images, with a penalty and checks as in OpenCV's example."""
    count, area = searched(most), BLOCK * BLOCK
    matcher = cv2.StereoSGBM.create(0, count, BLOCK, 8 * area, 32 * area, 1, 63, 10, 100, 2)
    began = time.process_time()
    disparity = matcher.compute(left, right)
    return SemiGlobal(np.asarray(disparity, np.float32) / np.float32(16), time.process_time() - began)


def searched(most: int) -> int:
    """How many disparities `cv2.StereoSGBM` searches for one of `most`: it takes multiples of 16 alone."""
    return -(-(most + 1) // 16) * 16


def least_columns(most: int) -> int:
    """Columns that a image must have for disparities up to `most`: half of them are seen by both cameras."""
    return max(2 * most, searched(most) + BLOCK)
