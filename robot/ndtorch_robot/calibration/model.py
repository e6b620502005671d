"""What is known about a pair of cameras, and the file it is kept in."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from ndtorch.arguments import as_path
from ndtorch.errors import InputError
from ndtorch.utils.files import write_text
from ndtorch.utils.toml import Strict, read_toml

Matrix = np.ndarray[Any, np.dtype[np.float64]]

Positive = Annotated[float, Field(gt=0)]
Vector = tuple[float, float, float]


class Lens(Strict):
    """One camera: the pinhole model with the distortion of Brown, as OpenCV has it.

    Args:
        fx_px, fy_px: focal lengths in pixels.
        cx_px, cy_px: where the optical axis meets the image; pixel centers are at whole numbers.
        distortion: k1, k2, p1, p2, k3, without unit.
    """

    fx_px: Positive
    fy_px: Positive
    cx_px: float
    cy_px: float
    distortion: tuple[float, float, float, float, float]

    @property
    def matrix(self) -> Matrix:
        return np.array([[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1]], np.float64)

    @property
    def coefficients(self) -> Matrix:
        return np.array(self.distortion, np.float64)


class Quality(Strict):
    """How well a calibration fits the images it was made from.

    Args:
        views: pairs of images used.
        left_px, right_px: root mean square distance of the corners from where each camera's model puts them.
        pair_px: the same with one common place of the board for both cameras.
        row_px: root mean square difference of the rows of a corner in both rectified images.
        row_95_px: 95 % of these differences are smaller.
        focal_percent: standard deviation of the focal lengths, the larger of both cameras.
        square_percent: by how much squares measured with the rectified pair differ from their true size (mean).
        tilt_deg: angle between the two boards of most different direction.
        covered_percent: share of the image that the boards covered, the smaller of both cameras.
    """

    views: Annotated[int, Field(ge=1)]
    left_px: Annotated[float, Field(ge=0)]
    right_px: Annotated[float, Field(ge=0)]
    pair_px: Annotated[float, Field(ge=0)]
    row_px: Annotated[float, Field(ge=0)]
    row_95_px: Annotated[float, Field(ge=0)]
    focal_percent: Annotated[float, Field(ge=0)]
    square_percent: float
    tilt_deg: Annotated[float, Field(ge=0, le=180)]
    covered_percent: Annotated[float, Field(ge=0, le=100)]


class Calibration(Strict):
    """A stereo calibration.

    A point p of the left camera's frame (x right, y down, z ahead, metres) is at `R p + t` in the right one's.

    Args:
        format: what the file is.
        width_px, height_px: size of the images it is made from and for.
        left, right: the cameras.
        rotation_rad: R as a rotation vector, radians.
        translation_m: t, metres; about (-baseline, 0, 0).
        focal_px: focal length of the rectified pair.
        quality: how well it fits.
    """

    format: Literal["ndtorch stereo calibration 1"] = "ndtorch stereo calibration 1"
    width_px: Annotated[int, Field(ge=16, le=8192)]
    height_px: Annotated[int, Field(ge=16, le=8192)]
    rotation_rad: Vector
    translation_m: Vector
    focal_px: Positive
    left: Lens
    right: Lens
    quality: Quality

    @property
    def baseline_m(self) -> float:
        return math.hypot(*self.translation_m)

    @property
    def rotation(self) -> Matrix:
        import cv2

        return np.asarray(cv2.Rodrigues(np.array(self.rotation_rad))[0], np.float64)

    def rectification(self) -> tuple[Matrix, Matrix]:
        """Rotations from each camera's frame to that of the parallel pair: rows along the baseline."""
        import cv2

        lenses = (self.left.matrix, self.left.coefficients, self.right.matrix, self.right.coefficients)
        pose = (self.rotation, np.array(self.translation_m).reshape(3, 1))
        size = (self.width_px, self.height_px)
        found = cv2.stereoRectify(*lenses, size, *pose, flags=cv2.STEREO_ZERO_DISPARITY)
        return np.asarray(found[0], np.float64), np.asarray(found[1], np.float64)

    def camera_matrix(self) -> Matrix:
        """The matrix of both rectified cameras: the axis in the middle of the image, as `StereoRig` has it."""
        f, cx, cy = self.focal_px, (self.width_px - 1) / 2, (self.height_px - 1) / 2
        return np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]], np.float64)


def read_calibration(path: str | Path) -> Calibration:
    """Read a calibration.

    Raises:
        InputError: a file that cannot be read, or is no calibration.
    """
    return read_toml(as_path("path", path), Calibration)


def write_calibration(calibration: Calibration, path: str | Path) -> None:
    """Write a calibration as TOML: a file of the same numbers is the same to the byte.

    Raises:
        InputError: a folder that cannot be written into.
    """
    import tomli_w

    path = as_path("path", path)
    text = "# Two cameras, measured with a chessboard by `ndtorch calibrate`.\n" + tomli_w.dumps(
        calibration.model_dump(mode="json")
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    except OSError as error:
        raise InputError(f"{path}: cannot write the calibration ({error.strerror})") from None
