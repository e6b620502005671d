"""Rectifying the few pixels that navigation reads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Rect, StereoRig, Strips
from ndtorch_robot.calibration.model import Calibration, Lens, Matrix
from ndtorch_robot.cameras.source import Image

LEAST_SEEN = 0.97
"""Share of the pixels of a strip that the raw image must hold."""


class Rectifier:
    """Reads the horizon row and the subfield of both rectified images out of the raw ones.

    For each of these pixels it is worked out once where in the raw image it lies; the rest of the image is
    never touched.

    Args:
        calibration: of the pair.
        rig: where the cameras are on the car; baseline, focal length and axis are taken from the calibration.
        fields: the subfields of the rectified images; `rig.subfields()` by default.

    Attributes:
        rig: the geometry of the rectified pair: what the navigator must be made with.

    Raises:
        InputError: a calibration of another size than the rig's frames, or cameras turned so far apart that the
            strips leave the images.
    """

    def __init__(self, calibration: Calibration, rig: StereoRig, fields: tuple[Rect, Rect] | None = None) -> None:
        self.calibration = calibration
        self.check_size(rig.width, rig.height)
        self.rig = replace(rig, baseline=calibration.baseline_m, focal=calibration.focal_px, cx=None, cy=None)
        fields = fields or self.rig.subfields()
        row = Rect(self.rig.row, self.rig.row + 1, 0, rig.width)
        matrix = calibration.camera_matrix()
        self.maps = []
        lenses = (calibration.left, calibration.right)
        for name, lens, turn, field in zip(("left", "right"), lenses, calibration.rectification(), fields, strict=True):
            maps = [strip_map(lens, turn, matrix, rect) for rect in (field, row)]
            seen = min(inside(*one, rig.width, rig.height) for one in maps)
            if seen < LEAST_SEEN:
                raise InputError(
                    f"the {name} camera sees only {100 * seen:.0f} % of what navigation reads of it: "
                    f"turn the cameras until they look the same way, and calibrate again"
                )
            self.maps.append(maps)

    def check_size(self, width: int, height: int) -> None:
        """Raise `InputError` when the calibration is for images of another size."""
        c = self.calibration
        if (width, height) != (c.width_px, c.height_px):
            raise InputError(
                f"the calibration is for {c.width_px}x{c.height_px} frames and cannot be used for {width}x{height}: "
                f"calibrate at that size"
            )

    def strips(self, left: Image, right: Image) -> tuple[Strips, Strips]:
        """Strips `[1, C, h, w]` uint8, red, green, blue, of two raw images as OpenCV gives them."""
        import cv2

        found = []
        for image, maps in zip((left, right), self.maps, strict=True):
            if image.shape[:2] != (self.calibration.height_px, self.calibration.width_px):
                self.check_size(image.shape[1], image.shape[0])
            # Cubic: a straight line between pixels blurs each by its own amount, and patches are compared.
            parts = [cv2.remap(image, x, y, cv2.INTER_CUBIC) for x, y in maps]
            found.append(Strips(*(to_planes(np.asarray(part, np.uint8)) for part in parts)))
        return found[0], found[1]


def strip_map(lens: Lens, turn: Matrix, matrix: Matrix, rect: Rect) -> tuple[Matrix, Matrix]:
    """Where in the raw image the pixels of a rectangle of the rectified one lie: columns and rows."""
    import cv2

    shifted = matrix.copy()
    shifted[:2, 2] -= (rect.left, rect.top)
    size = (rect.right - rect.left, rect.bottom - rect.top)
    x, y = cv2.initUndistortRectifyMap(lens.matrix, lens.coefficients, turn, shifted, size, cv2.CV_32FC1)
    return np.asarray(x), np.asarray(y)


def inside(x: Matrix, y: Matrix, width: int, height: int) -> float:
    return float(((x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)).mean())


def to_planes(image: Image) -> torch.Tensor:
    """`[h, w, 3]` blue, green, red to `[1, 3, h, w]` red, green, blue; grey `[h, w]` to `[1, 1, h, w]`."""
    if image.ndim == 2:
        return torch.from_numpy(image)[None, None]
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)[::-1]))[None]
