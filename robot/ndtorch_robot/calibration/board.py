"""Finding a chessboard in both images of a pair."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ndtorch.arguments import as_path, check_numbers
from ndtorch.errors import InputError
from ndtorch.scenes.image_folder import FolderReader
from ndtorch_robot.cameras.source import Image

Points = np.ndarray[Any, np.dtype[np.float32]]


@dataclass(frozen=True)
class Board:
    """A chessboard.

    Args:
        columns, rows: inner corners, where four squares meet; not as many one way as the other.
        square: side of a square, m.

    Raises:
        InputError: a number out of range.
    """

    columns: int = 9
    rows: int = 6
    square: float = 0.025

    def __post_init__(self) -> None:
        check_numbers(self)
        if min(self.columns, self.rows) < 3 or not 0 < self.square < 1:
            raise InputError(
                f"a board needs 3 x 3 inner corners or more, columns x rows, and squares of less than 1 m, "
                f"got {self.columns} x {self.rows} of {self.square} m"
            )
        if self.columns == self.rows:
            raise InputError(
                f"the board must have more inner corners one way than the other, got {self.columns} x {self.rows}: "
                f"a square one looks the same when turned by 90 degrees"
            )

    @property
    def points(self) -> Points:
        """The corners on the board, m, `[n, 3]`, row by row."""
        grid = np.zeros((self.rows * self.columns, 3), np.float32)
        grid[:, :2] = np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2) * self.square
        return grid


class View(NamedTuple):
    """Corners of one board in both images, `[n, 2]` pixels each."""

    left: Points
    right: Points


def find_corners(image: Image, board: Board) -> Points | None:
    """The inner corners `[n, 2]`, row by row, or None where the whole board is not seen.

    They may begin at either end of the board, which is the same turned by 180 degrees.
    """
    import cv2

    if image.dtype != np.uint8 or image.ndim not in (2, 3) or 0 in image.shape or image.shape[2:] not in ((), (3,)):
        raise InputError(f"image must be uint8 [h, w] or [h, w, 3], got {image.dtype} {list(image.shape)}")
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    size = (board.columns, board.rows)
    found, corners = cv2.findChessboardCorners(grey, size)
    if not found:
        return None
    corners = np.asarray(corners, np.float32).reshape(-1, 2)
    grid = corners.reshape(board.rows, board.columns, 2)
    gap = min(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1))
    # As large a window as fits without the next corner in it.
    half = int(np.clip(0.4 * gap, 2, 11))
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-3)
    return np.asarray(cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), criteria), np.float32).reshape(-1, 2)


def find_view(left: Image, right: Image, board: Board) -> View | None:
    """The corners in both images in the same order, or None unless both show the whole board."""
    first = find_corners(left, board)
    second = None if first is None else find_corners(right, board)
    if first is None or second is None:
        return None
    # Cameras that look the same way see the board the same way up.
    if float((first[-1] - first[0]) @ (second[-1] - second[0])) < 0:
        second = np.ascontiguousarray(second[::-1])
    return View(first, second)


def find_views(pairs: Iterable[tuple[Image, Image]], board: Board) -> Iterator[View | None]:
    for left, right in pairs:
        yield find_view(left, right, board)


def folder_pairs(left: str | Path, right: str | Path) -> list[tuple[Path, Path]]:
    """Pictures of two folders, in natural order, side by side.

    Raises:
        InputError: a folder that is not there, holds no images, or another number than the other one.
    """
    files = []
    for folder in (as_path("left", left), as_path("right", right)):
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder")
        files.append(FolderReader(folder).files)
    if len(files[0]) != len(files[1]):
        raise InputError(
            f"the folders must hold as many images, got {len(files[0])} in {left} and {len(files[1])} in {right}"
        )
    return list(zip(*files, strict=True))
