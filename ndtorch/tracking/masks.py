"""Masks of tracks: which pixel is whose, and what is measured of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.foreground.arrays import Bytes, Floats, Labels, Numbers
from ndtorch.foreground.segmentation import Segmentation
from ndtorch.tracking._kernels_blobs import label_share
from ndtorch.tracking._kernels_tracks import MeasuredImages, mark_tracks, measure_masks
from ndtorch.tracking.color_names import WhiteBalance
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.track import Track

OCCLUSION_BLUR_PX = 5
"""Pixels of a shared blob are compared by their mean over a square of this side: single pixels are noise."""
COLOR, SHARES = slice(7, 10), slice(10, 14)
"""Columns of what is measured of a mask."""


class Detection(NamedTuple):
    """What a track gets at one step.

    Attributes:
        inner: row and column of the place in its mask nearest to the mean of its pixels.
        place, extent: middle of its box, and its height and width.
        pixels: area in squared heights.
        color: mean, `[3]`.
        shades: shares of white, grey, black and hues, `[4]`.
        contrast: mean difference from the background in deviations of the noise; 0 of objects.
        shared: whether it shares its blob.
    """

    inner: tuple[float, float]
    place: tuple[float, float]
    extent: tuple[float, float]
    pixels: float
    color: Numbers
    shades: Numbers
    contrast: float
    shared: bool

    def window(self, height: int) -> tuple[slice, slice]:
        """Rows and columns of its box in an image of so many rows."""
        (row, column), (tall, wide) = self.place, self.extent
        top, left = round((row - tall / 2) * height), round((column - wide / 2) * height)
        return slice(top, top + round(tall * height)), slice(left, left + round(wide * height))


def measure_detections(
    tracks: Sequence[Track], labels: Labels, seen: Segmentation, light: WhiteBalance, shared: set[int]
) -> list[Detection | None]:
    """What the masks show of each track; None of those without pixels.

    The contrast is measured for tentative tracks that do not share their blob.

    Args:
        labels: number of the track of every pixel plus one, `[h, w]`.
        shared: numbers of the tracks that share a blob.
    """
    height, names = labels.shape[0], [one.number + 1 for one in tracks]
    slots = np.zeros(max(names, default=0) + 1, np.int32)
    slots[names] = np.arange(len(names))
    doubted = np.array([not one.is_object and one.number not in shared for one in tracks], bool)
    images = MeasuredImages(seen.image, seen.background, seen.deviation, seen.noise)
    table = np.zeros((len(names), 15))
    measure_masks(labels, slots, doubted, images, light.numbers(), table)
    found: list[Detection | None] = []
    for one, row, (top, left, bottom, right, pixels, down, across, *_, contrast) in zip(
        tracks, table, table.tolist(), strict=True
    ):
        if not pixels:
            found.append(None)
            continue
        place, extent = ((top + bottom) / 2 / height, (left + right) / 2 / height), (bottom - top, right - left)
        size, inner = (extent[0] / height, extent[1] / height), (down / height, across / height)
        looks = pixels / height**2, row[COLOR], row[SHARES], contrast, one.number in shared
        found.append(Detection(inner, place, size, *looks))
    return found


def object_mask(
    labels: Labels, objects: Sequence[int], kept: Sequence[int], quiet: Sequence[int], count: int, under: Floats
) -> Bytes:
    """1 where objects are, 0 elsewhere, `[h, w]`.

    Args:
        labels: number of the track of every pixel plus one, `[h, w]`.
        objects, kept, quiet: numbers of tracks; count: tracks begun so far.
        under: becomes 3 where one of `quiet` is or beside it, 1 where one of `kept` is, 0 elsewhere, `[h, w]`.
    """
    marks = np.zeros((count + 1, 2), np.uint8)
    marks[[number + 1 for number in objects], 0] = 1
    marks[[number + 1 for number in kept], 1] = 1
    marks[[number + 1 for number in quiet], 1] |= 2
    mask = np.empty(labels.shape, np.uint8)
    mark_tracks(labels, marks, mask, under)
    return mask


def marked_share(labels: Labels, marked: Bytes, tracks: Sequence[Track]) -> Numbers:
    """Share of the pixels of every track that are marked, `[K]`."""
    numbers = [one.number + 1 for one in tracks]
    # Fresh memory of zeros costs nothing where nobody looks, so the number of all tracks so far does not matter.
    counts, areas = np.zeros(max(numbers) + 1, np.int64), np.zeros(max(numbers) + 1, np.int64)
    label_share(labels, marked, counts, areas)
    return np.asarray(counts[numbers] / np.maximum(areas[numbers], 1))


def share_pixels(
    masks: Labels,
    labels: Labels,
    r: int,
    box: npt.NDArray[np.int64],
    tracks: Sequence[Track],
    time: float,
    image: Floats,
    p: TrackingParams,
) -> None:
    """Give each pixel of a blob to one of several tracks: by distance from where they are expected, and by color.

    Args:
        masks: number of the track of every pixel plus one, `[h, w]`; changed.
        labels: number of the blob of every pixel, `[h, w]`.
        r: the blob, and box: its top, left, bottom and right.
        image: `[3, h, w]`, 0..1.
    """
    import cv2

    height = labels.shape[0]
    top, left, bottom, right = box.tolist()
    window = labels[top:bottom, left:right] == r + 1
    here = masks[top:bottom, left:right]
    if len(tracks) == 1:
        here[window] = tracks[0].number + 1
        return
    rows = (np.arange(top, bottom) + 0.5)[:, None] / height
    columns = (np.arange(left, right) + 0.5)[None] / height
    square = (OCCLUSION_BLUR_PX, OCCLUSION_BLUR_PX)
    part = [np.asarray(cv2.blur(plane[top:bottom, left:right], square)) for plane in image]
    costs = []
    for one in tracks:
        place = one.expected(time, p.max_prediction_s)
        away = ((rows - place[0]) / one.extent[0]) ** 2 + ((columns - place[1]) / one.extent[1]) ** 2
        most = np.zeros_like(part[0])
        for plane, own in zip(part, one.color.tolist(), strict=True):
            np.maximum(most, np.abs(plane - np.float32(own)), out=most)
        costs.append(away + p.occlusion_color_cost * most**2)
    nearest = np.array([one.number + 1 for one in tracks], np.int32)[np.argmin(np.stack(costs), 0)]
    here[window] = nearest[window]
