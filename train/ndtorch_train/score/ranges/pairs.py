"""Stereo pairs with the true disparity of every left pixel, and what real cameras add to them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError

Picture = npt.NDArray[np.uint8]
Disparity = npt.NDArray[np.float32]

KITTI = 256.0
"""A pixel of disparity in files of 16 bits whose name tells no other scale."""


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
    left: Picture
    right: Picture
    truth: Disparity


def pair_folders(folder: Path) -> list[Path]:
    """The folders that hold a left.png, sorted by name; the folder itself if it does.

    Raises:
        InputError: there is none.
    """
    if (folder / "left.png").is_file():
        return [folder]
    found = sorted(path.parent for path in folder.glob("*/left.png"))
    if not found:
        raise InputError(f"{folder} holds no pairs: expected folders with left.png, right.png and disp*.png or .tif")
    return found


def read_pair(folder: Path, number: int = 0) -> Pair:
    """Read left.png, right.png, and the truth: the one file whose name begins with `disp`.

    Its values are pixels in files of floating point (.tif, .pfm), pixels times N where its name ends in `_xN`, and
    otherwise pixels times 256, as KITTI has them. What is 0, negative or not finite is not known.

    Raises:
        InputError: a file that is missing, cannot be read, or has another size than left.png.
    """
    left, right = picture(folder / "left.png"), picture(folder / "right.png")
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


def picture(path: Path) -> Picture:
    """A picture in grey."""
    return np.asarray(read(path, color=True), np.uint8)


def read(path: Path, color: bool) -> npt.NDArray[Any]:
    """A file as an array; made grey where it is a picture in color."""
    import cv2

    logging: Any = cv2.utils.logging
    before = logging.getLogLevel()
    try:
        logging.setLogLevel(logging.LOG_LEVEL_ERROR)  # tags of maps in TIFF files are no matter here
        found = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE if color else cv2.IMREAD_UNCHANGED)
    finally:
        logging.setLogLevel(before)
    if found is None or found.ndim != 2:
        raise InputError(f"{path} cannot be read as a picture in grey")
    return found


@dataclass(frozen=True)
class Condition:
    """What is done to a pair: noise of so many levels of 1, and the right picture so many times as bright."""

    name: str
    noise: float = 0.0
    exposure: float = 1.0

    def views(self, pair: Pair, frames: int, seed: int) -> list[tuple[Picture, Picture]]:
        """The pair so many times, each with its own noise."""
        rng = np.random.default_rng((seed, pair.number))
        return [(self.one(pair.left, 1.0, rng), self.one(pair.right, self.exposure, rng)) for _ in range(frames)]

    def one(self, image: Picture, factor: float, rng: np.random.Generator) -> Picture:
        """One picture."""
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
