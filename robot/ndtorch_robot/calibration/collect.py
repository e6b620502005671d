"""Pairs of images with a board: from live cameras, chosen so that each says something new."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ndtorch.errors import InputError
from ndtorch.scenes.readers import quiet_opencv
from ndtorch.utils.files import replacing
from ndtorch_robot.calibration.board import Board, View, find_view
from ndtorch_robot.cameras import CamerasSilent, FramesEnded, StereoCameras
from ndtorch_robot.cameras.source import Image

NEW = 0.06
"""Shares of the image's width by which the corners must have moved, on average, since every view kept."""

SEEN = Callable[[int, View], None]


def collect(
    cameras: StereoCameras, board: Board, count: int, seconds: float, seen: SEEN, keep: Path | None = None
) -> list[View]:
    """Look for `seconds` at most until there are `count` different views of the board; `seen` is told their number and
    the newest one, and `keep/left` and `keep/right` get the images used.
    """
    views: list[View] = []
    until = time.monotonic() + seconds
    while len(views) < count and time.monotonic() < until:
        try:
            pair = cameras.read_pair()
        except CamerasSilent:
            continue
        except FramesEnded:
            break
        view = find_view(pair.left.image, pair.right.image, board)
        if view is None or not is_new(view, views, cameras.settings.width_px):
            continue
        views.append(view)
        if keep is not None:
            save(keep, len(views), pair.left.image, pair.right.image)
        seen(len(views), view)
    return views


def is_new(view: View, views: list[View], width: int) -> bool:
    return all(np.abs(view.left - other.left).mean() > NEW * width for other in views)


def save(folder: Path, number: int, left: Image, right: Image) -> None:
    """Keep a pair as `left/001.png` and `right/001.png`, for `ndtorch calibrate folder/left folder/right`."""
    import cv2

    for side, image in (("left", left), ("right", right)):
        path = folder / side / f"{number:03d}.png"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with replacing(path) as beside:
                beside.write_bytes(cv2.imencode(".png", image)[1].tobytes())
        except OSError as error:
            raise InputError(f"{path}: cannot keep the image ({error.strerror})") from None


def from_files(pairs: list[tuple[Path, Path]], board: Board, seen: SEEN) -> tuple[list[View], tuple[int, int]]:
    """Views of images in files, and their size (width, height)."""
    import cv2

    views: list[View] = []
    size: tuple[int, int] | None = None
    for files in pairs:
        images = []
        for path in files:
            with quiet_opencv():
                image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            if image is None:
                raise InputError(f"image {path} cannot be read: empty, damaged or not an image")
            given = (image.shape[1], image.shape[0])
            size = size or given
            if given != size:
                raise InputError(
                    f"all images must be of one size, {path} is {given[0]}x{given[1]} and others {size[0]}x{size[1]}"
                )
            images.append(np.asarray(image, np.uint8))
        view = find_view(images[0], images[1], board)
        if view is not None:
            views.append(view)
            seen(len(views), view)
    assert size is not None
    return views, size
