"""`ndtorch benchmark ranges`: ranges of single rows on images of real stereo cameras, beside OpenCV's matching.

Stereo pairs with the true disparity of every left pixel, under conditions that real cameras add.
"""

from __future__ import annotations

import functools
import platform
import re
import time
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import FeatureParams, MatchParams, SearchParams, StereoRanging, StereoRig
from ndtorch.report.page import Shown
from ndtorch_train.benchmark.base import Benchmark, Column, Row, Task, means

Image = npt.NDArray[np.uint8]
Disparity = npt.NDArray[np.float32]

KITTI = 256.0
"""A pixel of disparity in files of 16 bits whose name has no other scale."""
EVERY, MARGIN = 3, 3
"""Every so many rows of an image are taken for the horizon row, but none so near its border."""
BLOCK = 5
"""Pixels across what `cv2.StereoSGBM` compares; its other numbers are those of OpenCV's example."""
PUBLISHED, SEARCH, SGBM = "features", "search", "SGBM"

CONDITIONS = {
    "as it is": (0.0, 1.0),
    "noise 1 %": (0.01, 1.0),
    "right 10 % brighter": (0.0, 1.1),
    "right 10 % darker, noise 1 %": (0.01, 0.9),
}
"""What is done to a pair: standard deviation of noise, as a ratio of white, and brightness of the right image."""

COLUMNS = (
    Column("case", "pair, condition"),
    Column("method", "method"),
    Column("per_row", "a row", 1),
    Column("known_per_row", "with truth", 1),
    Column("within_1", "1 px", 3, better=1),
    Column("within_2", "2 px", 3, better=1),
    Column("within_10", "10 %", 3, better=1),
    Column("ms", "ms"),
)

NOTE = (
    "Every {every}rd row of an image is taken for the horizon row; disparities {low} to {high}. `features` is the "
    "published matching, `search` is `--stereo search`, both as the navigator runs them; SGBM is `cv2.StereoSGBM` on "
    "the whole image, read at the pixels of `search` where it has a disparity. Ratios are of the ranges whose truth is "
    "known. Time: processor time of one row (median), of SGBM of one image, one thread; {machine}, torch {torch}."
)


class PhotographPair(NamedTuple):
    """A rectified pair: grey images `[H, W]`, and the disparity of the left pixels, 0 where it is not known."""

    left: Image
    right: Image
    truth: Disparity


class Found(NamedTuple):
    """Disparities `[n]` at rows and columns of the left image; rows that were looked at; time of one of them, s."""

    row: npt.NDArray[np.int64]
    column: npt.NDArray[np.int64]
    disparity: npt.NDArray[np.float64]
    rows: int
    seconds: float


def range_benchmark(place: Path, disparities: tuple[int, int]) -> Benchmark:
    """The benchmark on every pair of a folder."""
    low, high = disparities
    if not 1 <= low < high - 1 or high > 1024:
        raise InputError(f"disparities must be two numbers 1 <= LEAST < LARGEST - 1 < 1024, got {low} {high}")
    tasks, images = list[Task](), list[tuple[str, str]]()
    for number, folder in enumerate(pair_folders(place)):
        columns = read_pair(folder).left.shape[1]
        if columns < 2 * high + BLOCK + 16:
            raise InputError(f"{folder.name}: {columns} columns are too few for disparities up to {high}")
        tasks.append(Task(folder.name, functools.partial(measure, folder, number, disparities)))
        images.append((f"pair-{number:03d}.png", folder.name))
    note = NOTE.format(every=EVERY, low=low, high=high, machine=platform.machine(), torch=torch.__version__)

    def shown(rows: list[Row], out: Path) -> list[Shown]:
        words = "Ranges of the search: blue right to 10 %, orange not, grey unknown."
        return [Shown(out / file, name, words) for file, name in images]

    settings = {"disparities": disparities, "pairs": str(place.resolve())}
    return Benchmark(
        "ranges", "Ranges on real stereo images", note, COLUMNS, tasks, mean_rows, shown, settings=settings
    )


def measure(place: Path, number: int, disparities: tuple[int, int], folder: Path) -> list[Row]:
    """Rows of all methods on a pair under all conditions; an image of what the search finds in the pair as it is."""
    pair, (low, high) = read_pair(place), disparities
    height, width = pair.left.shape
    # The lengths of the rig do not matter for disparities.
    rig, search = StereoRig(width=width, height=height, focal=float(width)), SearchParams()
    search = SearchParams(min_disparity_px=low, max_disparity_px=high)
    modules = {
        PUBLISHED: StereoRanging(rig, 1 / 30, FeatureParams(), MatchParams(low, high)),
        SEARCH: StereoRanging(rig, 1 / 30, search=search),
    }
    for module in modules.values():
        by_rows(module, [(pair.left[:12], pair.right[:12])] * 2)  # compiles what has to be, before the time is taken
    rows: list[Row] = []
    for condition, (noise, exposure) in CONDITIONS.items():
        rng = np.random.default_rng((0, number))
        views = [(spoiled(pair.left, noise, 1.0, rng), spoiled(pair.right, noise, exposure, rng)) for _ in range(2)]
        found = {name: by_rows(module, views) for name, module in modules.items()}
        if not rows:
            draw_pair(pair, found[SEARCH], folder / f"pair-{number:03d}.png")
        found[SGBM] = semi_global(*views[1], high, found[SEARCH])
        for name, one in found.items():
            case = {"case": f"{place.name}, {condition}", "condition": condition, "number": number}
            rows.append({**case, "method": name, **judge(one, pair.truth), "ms": 1e3 * one.seconds})
    return rows


def spoiled(image: Image, noise: float, exposure: float, rng: np.random.Generator) -> Image:
    """An image with noise and another brightness."""
    values = image * exposure + (rng.normal(0, 255 * noise, image.shape) if noise else 0)
    return np.asarray(values.round().clip(0, 255), np.uint8)


def draw_pair(pair: PhotographPair, found: Found, path: Path) -> None:
    """The left image with a point at every range: blue right to 10 %, orange not, grey unknown."""
    true, image = pair.truth[found.row, found.column], cv2.cvtColor(pair.left, cv2.COLOR_GRAY2BGR)
    for row, column, far, known in zip(found.row, found.column, abs(true / found.disparity - 1), true > 0, strict=True):
        color = (178, 114, 0) if known and far <= 0.1 else (0, 159, 230) if known else (153, 153, 153)
        cv2.circle(image, (int(column), int(row)), 2, color, -1)
    cv2.imwrite(str(path), image)


def judge(found: Found, truth: Disparity) -> Row:
    """Ranges a row, those with truth, and the ratios of disparities right to 1 px, to 2 px, and of ranges to 10 %."""
    true = truth[found.row, found.column].astype(np.float64)
    measured, true = found.disparity[true > 0], true[true > 0]
    off, far = np.abs(measured - true), np.abs(true / measured - 1)
    ratios = [float(np.mean(good)) if len(true) else None for good in (off <= 1, off <= 2, far <= 0.1)]
    counts = len(found.row) / max(found.rows, 1), len(true) / max(found.rows, 1)
    return dict(zip([column.key for column in COLUMNS[2:7]], (*counts, *ratios), strict=True))


def mean_rows(rows: list[Row]) -> list[Row]:
    """Means over all pairs, every pair alike."""
    groups: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for row in rows:
        groups[row["condition"], row["method"]].append(row)
    return [
        {"case": f"all pairs, {condition}", "method": method, **means(group, COLUMNS[2:])}
        for (condition, method), group in groups.items()
    ]


def pair_folders(folder: Path) -> list[Path]:
    """The folders that hold a left.png, sorted by name; the folder itself if it does."""
    pairs = [folder] if (folder / "left.png").is_file() else sorted(path.parent for path in folder.glob("*/left.png"))
    if not pairs:
        raise InputError(f"{folder} holds no pairs: expected folders with left.png, right.png and disp*.png or .tif")
    return pairs


def read_pair(folder: Path) -> PhotographPair:
    """Read left.png, right.png, and the truth: the one file whose name begins with `disp`.

    Its values are pixels in files of floating point (.tif, .pfm), pixels times N where its name ends in `_xN`, and
    otherwise pixels times 256, as KITTI has them. What is 0, negative or not finite is not known.
    """
    left, right = (read(folder / f"{eye}.png", cv2.IMREAD_GRAYSCALE) for eye in ("left", "right"))
    truths = sorted(path for path in folder.glob("disp*") if path.suffix in (".png", ".tif", ".tiff", ".pfm"))
    if len(truths) != 1:
        raise InputError(f"{folder} must hold one file disp*.png, .tif or .pfm, found {len(truths)}")
    truth = read(truths[0], cv2.IMREAD_UNCHANGED).astype(np.float32)
    if not left.shape == right.shape == truth.shape:
        raise InputError(f"{folder}: the sizes differ: left {left.shape}, right {right.shape}, truth {truth.shape}")
    scale = re.search(r"_x(\d+)$", truths[0].stem)
    truth /= float(scale[1]) if scale else KITTI if truths[0].suffix == ".png" else 1.0
    return PhotographPair(left, right, np.where(np.isfinite(truth) & (truth > 0), truth, 0).astype(np.float32))


def read(path: Path, mode: int) -> npt.NDArray[Any]:
    image = cv2.imread(str(path), mode)
    if image is None or image.ndim != 2:
        raise InputError(f"{path} cannot be read as an image in grey")
    return image


def by_rows(module: StereoRanging, views: list[tuple[Image, Image]]) -> Found:
    """Range every few rows.

    Args:
        views: the pair twice. The first is shown moved by one pixel, so that everything moves by that between the two
            frames, as when the car turns: what does not move has no features.
    """
    around, seconds, parts = module.row.bottom - module.row.top, list[float](), []
    rows = range(MARGIN, views[0][0].shape[0] - MARGIN, EVERY)
    with torch.inference_mode():
        for y in rows:
            state = None
            for view, moved in zip(views, (1, 0), strict=True):
                strips = (np.roll(image[y - around // 2 : y + around // 2 + 1], -moved, 1) for image in view)
                began = time.process_time()
                ranges, state = module(*(torch.from_numpy(strip)[None, None] for strip in strips), state)
            seconds.append(time.process_time() - began)
            angles = torch.stack((ranges.left_angle[-1], ranges.right_angle[-1]))[:, ranges.valid[-1]].double()
            left, right = (module.rig.center[0] - module.rig.focal * angles.tan()).numpy()
            parts.append(np.stack((np.full(len(left), y), left, left - right)))
    row, column, disparity = np.concatenate(parts, 1)
    return Found(row.astype(int), column.round().astype(int), disparity, len(rows), float(np.median(seconds)))


def semi_global(left: Image, right: Image, most: int, at: Found) -> Found:
    """Disparities of `cv2.StereoSGBM` on whole images, with checks as in OpenCV's example, where others found some."""
    area = BLOCK * BLOCK
    matcher = cv2.StereoSGBM.create(0, -(-(most + 1) // 16) * 16, BLOCK, 8 * area, 32 * area, 1, 63, 10, 100, 2)
    began = time.process_time()
    disparity = matcher.compute(left, right)[at.row, at.column] / 16
    seconds, known = time.process_time() - began, disparity > 0
    return Found(at.row[known], at.column[known], disparity[known].astype(np.float64), at.rows, seconds)
