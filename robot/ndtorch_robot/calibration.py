"""Stereo calibration with a chessboard, and rectification of the pixels that navigation reads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Rect, StereoRig, Strips
from ndtorch.navigation.stereo.calibration_files import Image, PairCamera, StereoCalibration, stereo_calibration
from ndtorch.utils.files import write_text

Points = np.ndarray[Any, np.dtype[np.float32]]
Matrix = np.ndarray[Any, np.dtype[np.float64]]

MIN_VIEWS = 10
"""Views below which the figures of merit themselves mean little."""

MIN_INSIDE = 0.97
"""Ratio of the pixels of a strip that the raw image must contain."""

ACCEPTED = {
    "left_px": (0.0, 0.5, "the left camera's model misses its corners by {:.2f} px"),
    "right_px": (0.0, 0.5, "the right camera's model misses its corners by {:.2f} px"),
    "pair_px": (0.0, 0.6, "both cameras together miss the corners by {:.2f} px"),
    "row_px": (0.0, 0.4, "the rows of the rectified images differ by {:.2f} px"),
    "focal_percent": (0.0, 1.0, "the focal length is known to {:.2f} % only: tilt the board by 30 degrees"),
    "tilt_deg": (25.0, 180.0, "the boards lie within {:.0f} degrees: tilt them by 30 degrees this way and that"),
    "covered_percent": (35.0, 100.0, "the boards covered {:.0f} % of the image only"),
}
"""Least and largest values of `Quality` that are accepted, and the fault beyond them."""

MIN_TILT_DEG = 10.0
"""Angle between the boards of most different direction below which a focal length of any size fits."""


@dataclass(frozen=True)
class Board:
    """A chessboard: inner corners, where four squares meet, not as many one way as the other; side of a square, m."""

    columns: int = 9
    rows: int = 6
    square: float = 0.025

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or self.columns == self.rows or not 0 < self.square < 1:
            words = "3 x 3 inner corners or more, not as many one way as the other, and squares of less than 1 m"
            raise InputError(f"a board needs {words}, got {self.columns} x {self.rows} of {self.square} m")

    @property
    def points(self) -> Points:
        """The corners on the board, m, `[n, 3]`, row by row."""
        grid = np.zeros((self.rows * self.columns, 3), np.float32)
        grid[:, :2] = np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2) * self.square
        return grid


class BoardView(NamedTuple):
    """Corners of one board in both images, `[n, 2]` pixels each."""

    left: Points
    right: Points


class Quality(NamedTuple):
    """How well a calibration fits its images; of both cameras the worse."""

    views: int  # pairs of images used
    left_px: float  # root mean square distance of the corners from where the camera's model puts them
    right_px: float
    pair_px: float  # the same with one common pose of the board for both cameras
    row_px: float  # root mean square difference of the rows of a corner in both rectified images
    focal_percent: float  # standard deviation of the focal lengths
    tilt_deg: float  # angle between the two boards of most different direction
    covered_percent: float  # cells of an 8 x 8 grid over the image with a corner

    def faults(self) -> list[str]:
        """What is not good enough, in words; nothing for a calibration that may be used."""
        values = [(getattr(self, name), *limits) for name, limits in ACCEPTED.items()]
        return [words.format(value) for value, least, most, words in values if not least <= value <= most]


def find_corners(image: Image, board: Board) -> Points | None:
    """The inner corners `[n, 2]` in a uint8 image, grey or BGR, row by row; None unless the whole board is visible."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    good, corners = cv2.findChessboardCorners(grey, (board.columns, board.rows))
    if not good:
        return None
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-3)
    return np.asarray(cv2.cornerSubPix(grey, corners, (5, 5), (-1, -1), criteria), np.float32).reshape(-1, 2)


def find_view(left: Image, right: Image, board: Board) -> BoardView | None:
    """The corners in both images in the same order, or None unless both show the whole board."""
    first = find_corners(left, board)
    second = None if first is None else find_corners(right, board)
    if first is None or second is None:
        return None
    # A board looks the same turned by 180 degrees; cameras that look the same way see it the same way up.
    upright = float((first[-1] - first[0]) @ (second[-1] - second[0])) > 0
    return BoardView(first, second if upright else np.ascontiguousarray(second[::-1]))


def calibrate(views: Sequence[BoardView], board: Board, size: tuple[int, int]) -> tuple[StereoCalibration, Quality]:
    """The pair of cameras, and how well it fits.

    Each camera on its own first, then the motion between them with the cameras held.

    Raises:
        InputError: fewer than `MIN_VIEWS` views, cameras that are swapped or one above the other, or views from which
            nothing can be computed.
    """
    if len(views) < MIN_VIEWS:
        raise InputError(f"{MIN_VIEWS} pairs that show the whole board are needed, got {len(views)}")
    objects, corners = [board.points] * len(views), ([v.left for v in views], [v.right for v in views])
    lenses, errors, focal, tilts, covered = [], [], [], [], []
    try:
        for points in corners:
            # k3 can hardly be told from k2 at these angles, and bends the corners of the image.
            error, matrix, distortion, turns, _, spread, *_ = cv2.calibrateCameraExtended(
                objects, points, size, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3
            )
            lenses.append((np.asarray(matrix, np.float64), np.asarray(distortion, np.float64).ravel()[:5]))
            errors.append(float(error))
            focal.append(100 * max(float(spread[i, 0]) / float(matrix[i, i]) for i in (0, 1)))
            normals = np.array([cv2.Rodrigues(np.asarray(one))[0][:, 2] for one in turns])
            tilts.append(float(np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1, 1)))))
            cells = np.floor(np.concatenate(points) * 8 / size).clip(0, 7)
            covered.append(100 * len(np.unique(cells, axis=0)) / 64)
        if min(tilts) < MIN_TILT_DEG:
            raise InputError(ACCEPTED["tilt_deg"][2].format(min(tilts)))
        pair, *_, rotation, translation, _, _ = cv2.stereoCalibrate(
            objects, *corners, *lenses[0], *lenses[1], size, flags=cv2.CALIB_FIX_INTRINSIC
        )
    except cv2.error as error:
        raise InputError(f"these views cannot be calibrated: {str(error).splitlines()[-1].strip()}") from None
    shift = np.asarray(translation, np.float64).ravel()
    if not np.isfinite(shift).all() or abs(shift[0]) < 2 * np.hypot(shift[1], shift[2]):
        raise InputError(f"the cameras must sit side by side, but the right one is at {-shift.round(3)} m of the left")
    if shift[0] > 0:
        raise InputError(f"left and right are swapped: the right camera is {shift[0]:.3f} m left of the left one")
    matrices, distortions = zip(*lenses, strict=True)
    calibration = stereo_calibration(matrices, distortions, np.asarray(rotation, np.float64), shift, size)
    left = rectified_points(np.concatenate(corners[0]), calibration.left)
    right = rectified_points(np.concatenate(corners[1]), calibration.right)
    row = float(np.sqrt(((left - right)[:, 1] ** 2).mean()))
    return calibration, Quality(
        len(views), errors[0], errors[1], float(pair), row, max(focal), min(tilts), min(covered)
    )


def rectified_points(points: Matrix | Points, camera: PairCamera) -> Matrix:
    """Pixels `[n, 2]` of a raw image as those of the rectified one."""
    raw = np.asarray(points, np.float64).reshape(-1, 1, 2)
    moved = cv2.undistortPoints(raw, camera.matrix, camera.distortion, R=camera.rotation, P=camera.projection[:, :3])
    return np.asarray(moved, np.float64).reshape(-1, 2)


def write_calibration(calibration: StereoCalibration, quality: Quality, path: Path) -> None:
    """Write a calibration as YAML with the names of OpenCV, which `ndtorch.navigation.StereoRig.load` reads.

    Raises:
        InputError: a folder that cannot be written into.
    """
    left, right = calibration.left, calibration.right
    assert calibration.size is not None
    turn = right.rotation.T @ left.rotation
    shift = right.rotation.T[:, 0] * right.projection[0, 3] / right.projection[0, 0]
    values = {"M1": left.matrix, "D1": left.distortion, "M2": right.matrix, "D2": right.distortion}
    values |= {"R": turn, "T": shift}
    lines = ["# Stereo calibration by `ndtorch calibrate`: pixels, metres, from the left camera to the right one"]
    lines += [f"image_width: {calibration.size[0]}", f"image_height: {calibration.size[1]}"]
    lines += [f"{name}: {np.ravel(value).tolist()}" for name, value in values.items()]
    lines += ["quality:", *(f"  {name}: {value}" for name, value in quality._asdict().items())]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, "\n".join(lines) + "\n")
    except OSError as error:
        raise InputError(f"{path}: cannot write the calibration ({error.strerror})") from None


class Rectifier:
    """Reads the horizon row and the subfield of both rectified images out of the raw ones.

    Where these pixels lie in the raw images is computed once; the rest of the images is never touched.

    Args:
        rig: where the cameras are on the car; baseline, focal length and axis are those of the calibration.
            The attribute of this name is that of the rectified pair, with which the navigator must be made.
        fields: the subfields of the rectified images; `rig.subfields()` by default.

    Raises:
        InputError: a calibration of another size than the rig's frames, or cameras turned so far apart that the
            strips leave the images.
    """

    def __init__(self, calibration: StereoCalibration, rig: StereoRig, fields: tuple[Rect, Rect] | None = None) -> None:
        cameras, wide, high = (calibration.left, calibration.right), rig.width, rig.height
        if calibration.size not in (None, (wide, high)):
            raise InputError(f"the calibration is for {calibration.size} frames and cannot be used for {wide}x{high}")
        self.size = (high, wide)
        focal = float(np.mean([camera.matrix[i, i] for camera in cameras for i in (0, 1)]))
        baseline = -float(calibration.right.projection[0, 3] / calibration.right.projection[0, 0])
        self.rig = replace(rig, baseline=baseline, focal=focal, cx=None, cy=None)
        row = Rect(self.rig.row, self.rig.row + 1, 0, wide)
        self.maps = []
        for side, camera, field in zip(("left", "right"), cameras, fields or self.rig.subfields(), strict=True):
            maps = []
            for rect in (field, row):
                center = ((wide - 1) / 2 - rect.left, (high - 1) / 2 - rect.top)
                matrix = np.array([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1]])
                x, y = camera.maps(matrix, (rect.right - rect.left, rect.bottom - rect.top))
                inside = (x >= 0) & (x <= wide - 1) & (y >= 0) & (y <= high - 1)
                if inside.mean() < MIN_INSIDE:
                    raise InputError(
                        f"the {side} camera sees only {100 * inside.mean():.0f} % of what navigation reads of it: "
                        f"turn the cameras until they look the same way, and calibrate again"
                    )
                maps.append((x, y))
            self.maps.append(maps)

    def strips(self, left: Image, right: Image) -> tuple[Strips, Strips]:
        """Strips `[1, C, h, w]` uint8, red, green, blue, of two raw images as OpenCV gives them."""
        strips = []
        for image, maps in zip((left, right), self.maps, strict=True):
            if image.shape[:2] != self.size:
                raise InputError(f"the calibration is for {self.size[::-1]} frames, got {image.shape[1::-1]}")
            # Cubic: a straight line between pixels blurs each by its own amount, and patches are compared.
            parts = [np.atleast_3d(cv2.remap(image, x, y, cv2.INTER_CUBIC)) for x, y in maps]
            planes = [np.ascontiguousarray(part[..., ::-1].transpose(2, 0, 1), np.uint8) for part in parts]
            strips.append(Strips(*(torch.from_numpy(plane)[None] for plane in planes)))
        return strips[0], strips[1]
