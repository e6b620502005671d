"""Pictures of a run that are kept for its page: ground, crops of objects and a poster."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ndtorch.binding import BoundObject
from ndtorch.run.watchers import Picture, Pixels, Watcher

GROUND_SIDE, GROUNDS = 960, 15
"""Longest side of the picture of the ground, pixels, and of how many pictures it is the median."""
CROP_SIDE, CROPS = 200, 60
"""Longest side of the crop of an object, pixels, and of how many objects there is one."""


class Crop(NamedTuple):
    """The clearest view of an object: its pixels `[h, w, 3]`, and how clear it is."""

    pixels: Pixels
    clearness: float


class Gallery(Watcher):
    """Keeps a few pictures, in bounded memory.

    Attributes:
        crops: of objects, by their numbers.
        poster: the picture with the most of the objects boxed, and these.
    """

    def __init__(self) -> None:
        self.crops = dict[int, Crop]()
        self.poster: tuple[Pixels, tuple[BoundObject, ...]] | None = None
        self._kept, self._stride, self._seen = list[Pixels](), 1, 0
        self._best = 0.0

    def picture(self, picture: Picture) -> None:
        if picture.enhanced is not None:
            return
        if self._seen % self._stride == 0:
            self._kept.append(shrunk(picture.frame, GROUND_SIDE))
            if len(self._kept) > GROUNDS:
                self._kept, self._stride = self._kept[::2], 2 * self._stride
        self._seen += 1
        height, width = picture.frame.shape[:2]
        total = 0.0
        for thing in picture.objects:
            if thing.box is None or thing.number is None:
                continue
            left, top, right, bottom = thing.box
            whole = left > 2 and top > 2 and right < width - 2 and bottom < height - 2
            clearness = (right - left) * (bottom - top) * (1.0 if whole else 0.2)
            total += clearness**0.5
            known = self.crops.get(thing.number)
            if clearness > (0.0 if known is None else known.clearness) and (known or len(self.crops) < CROPS):
                self.crops[thing.number] = Crop(cut(picture.frame, thing.box), clearness)
        if total > self._best:
            self._best, self.poster = total, (picture.frame, picture.objects)

    def ground(self) -> Pixels | None:
        """The median of the pictures, without what passed; None before any."""
        if not self._kept:
            return None
        return np.asarray(np.median(np.stack(self._kept), axis=0), dtype=np.uint8)


def shrunk(image: Pixels, longest: int) -> Pixels:
    """An image of which no side is longer than that."""
    import cv2

    scale = longest / max(image.shape[:2])
    if scale >= 1:
        return image
    size = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def cut(frame: Pixels, box: tuple[float, float, float, float]) -> Pixels:
    """What is in a box and a tenth around it."""
    left, top, right, bottom = box
    rim = 0.1 * max(right - left, bottom - top) + 2
    rows = slice(max(0, int(top - rim)), max(1, int(bottom + rim)))
    part = frame[rows, max(0, int(left - rim)) : max(1, int(right + rim))]
    return shrunk(np.ascontiguousarray(part), CROP_SIDE)


def contact_sheet(crops: dict[int, Crop], columns: int = 6) -> Pixels | None:
    """The crops side by side, each over the number of its object, `[H, W, 3]`; None without any."""
    import cv2

    if not crops:
        return None
    line, edge = 28, CROP_SIDE + 8
    across = min(columns, len(crops))
    sheet = np.full((-(-len(crops) // across) * (edge + line), across * edge, 3), 255, np.uint8)
    for place, number in enumerate(sorted(crops)):
        pixels = crops[number].pixels
        scale = CROP_SIDE / max(pixels.shape[:2])
        size = max(1, round(pixels.shape[1] * scale)), max(1, round(pixels.shape[0] * scale))
        large = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_CUBIC))
        top, left = place // across * (edge + line), place % across * edge
        sheet[top : top + size[1], left : left + size[0]] = large
        at = left + 2, top + CROP_SIDE + 22
        cv2.putText(sheet, f"object {number}", at, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (40, 40, 40), 1, cv2.LINE_AA)
    return sheet


def write_jpeg(image: Any, path: Any) -> None:
    """Write red, green and blue `[H, W, 3]` as a JPEG file."""
    import cv2

    _, data = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 88])
    path.write_bytes(data.tobytes())
