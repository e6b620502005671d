"""What gives disparities: the published matching and the search of single rows, and OpenCV's semi-global matching."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch

from ndtorch.navigation import FeatureParams, MatchParams, RowRanging, StereoRig
from ndtorch.navigation.row_search import SearchParams
from ndtorch_train.score.ranges.pairs import Disparity, Picture

Floats = npt.NDArray[np.float64]

EVERY, MARGIN = 3, 3
"""Every so many rows of a picture are taken for the horizon row, but none so near its border."""

BLOCK = 5
"""Pixels across what `cv2.StereoSGBM` compares; its other numbers are those of OpenCV's example."""


class Found(NamedTuple):
    """Disparities of a picture.

    Attributes:
        row, column: of the left pixels, `[n]`.
        disparity: `[n]`.
        rows: how many rows were looked at.
        seconds: processor time of one row, or of the whole picture where that is done at once.
    """

    row: npt.NDArray[np.int64]
    column: npt.NDArray[np.int64]
    disparity: Floats
    rows: int
    seconds: float


def looked_at(height: int) -> range:
    """The rows of a picture that are taken for the horizon row, one after the other."""
    return range(MARGIN, height - MARGIN, EVERY)


def ranging(width: int, height: int, disparities: tuple[int, int], search: bool) -> RowRanging:
    """The navigator's ranging for pictures of a size; the rig's lengths do not matter for disparities."""
    rig, (low, high) = StereoRig(width=width, height=height, focal=float(width)), disparities
    if search:
        return RowRanging(rig, 1 / 30, search=SearchParams(min_disparity=low, max_disparity=high))
    return RowRanging(rig, 1 / 30, FeatureParams(), MatchParams(low, high))


def by_rows(module: RowRanging, views: list[tuple[Picture, Picture]]) -> Found:
    """Range every few rows.

    Args:
        module: of `ranging`.
        views: the pair twice. The first is shown moved by one pixel, so that everything moves by that between the two
            frames, as when the car turns: what does not move has no features.
    """
    around = module.row.bottom - module.row.top
    found: list[tuple[int, Floats, Floats]] = []
    seconds, rows = [], looked_at(views[0][0].shape[0])
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


def strips(view: tuple[Picture, Picture], y: int, around: int, moved: int) -> Iterator[torch.Tensor]:
    """Rows `[1, 1, around, W]` of both pictures, moved by so many pixels to the left."""
    for image in view:
        rows = np.roll(image[y - around // 2 : y + around // 2 + 1], -moved, 1)
        yield torch.from_numpy(np.ascontiguousarray(rows))[None, None]


class SemiGlobal(NamedTuple):
    """Disparities `[H, W]` by `cv2.StereoSGBM` (not above 0 where it finds none), and its processor time."""

    disparity: Disparity
    seconds: float

    def at(self, found: Found) -> Found:
        """What it says at the pixels that others found."""
        said = self.disparity[found.row, found.column]
        known = said > 0
        return Found(found.row[known], found.column[known], said[known].astype(np.float64), found.rows, self.seconds)


def semi_global(left: Picture, right: Picture, most: int) -> SemiGlobal:
    """`cv2.StereoSGBM` on whole pictures, with a penalty and checks as in OpenCV's example."""
    import cv2

    count, area = searched(most), BLOCK * BLOCK
    matcher = cv2.StereoSGBM.create(0, count, BLOCK, 8 * area, 32 * area, 1, 63, 10, 100, 2)
    began = time.process_time()
    disparity = matcher.compute(left, right)
    return SemiGlobal(np.asarray(disparity, np.float32) / np.float32(16), time.process_time() - began)


def searched(most: int) -> int:
    """How many disparities `cv2.StereoSGBM` looks at for one of `most`: it takes multiples of 16 alone."""
    return -(-(most + 1) // 16) * 16


def least_columns(most: int) -> int:
    """Columns that a picture must have for disparities up to `most`: half of them are seen by both eyes."""
    return max(2 * most, searched(most) + BLOCK)
