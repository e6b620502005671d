"""Two parallel forward cameras: pixels, angles, rays and the patches of floor they look at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError

AngleModel = Literal["atan", "linear"]

Matrix = Sequence[Sequence[float]] | Tensor | npt.NDArray[Any]

ALIKE = 1e-3
"""Ratio of the focal length by which matrices of a rectified pair may differ: files give a few decimals."""

MAX_BASELINE = 2.0  # metres: a longer baseline is most often one in millimetres
LONGEST_SIDE = 2**20  # pixels of a side of a frame, at most


class Rect(NamedTuple):
    """A rectangle of pixels, rows `top..bottom - 1` and columns `left..right - 1`."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def size(self) -> tuple[int, int]:
        return self.bottom - self.top, self.right - self.left


@dataclass(frozen=True)
class StereoRig:
    """Geometry of the camera pair of [A Methods].

    Body frame: x forward, y left, lengths in metres, angles in radians counter-clockwise. The cameras look
    along x and sit at y = +baseline / 2 (left) and -baseline / 2 (right).

    Args:
        baseline: distance between the cameras, m.
        focal: focal length in pixels.
        width, height: size of a frame in pixels.
        camera_height: height of the cameras above the floor, m.
        pitch: how far the cameras look down, radians.
        forward: place of the cameras ahead of the point the body turns about, m.
        cx, cy: column and row where the axes of both cameras meet the frames, pixel centers at whole numbers; the
            middle of the frames by default. `from_projections` reads them from what a calibration gives.

    Raises:
        InputError: a number out of range.

    >>> rig = StereoRig(baseline=0.2, width=320, height=240, focal=215.0)
    >>> rig.subfields()[0]
    Rect(top=149, bottom=163, left=102, right=145)
    """

    baseline: float = 0.30
    focal: float = 430.0
    width: int = 640
    height: int = 480
    camera_height: float = 0.20
    pitch: float = 0.0
    forward: float = 0.0
    cx: float | None = None
    cy: float | None = None

    @classmethod
    def load(
        cls,
        *paths: str | Path,
        width: int | None = None,
        height: int | None = None,
        unit_m: float = 1.0,
        cameras: tuple[int, int] = (0, 1),
        **where: float,
    ) -> StereoRig:
        """The rig of a calibration that somebody else has made, in one file or in one a camera, the left one first.

        It is the rig of the rectified pair; `load_calibration` has what rectifies images.

        Args:
            paths, width, height, unit_m, cameras: as `load_calibration`, with the formats that are read.
            where: `camera_height`, `pitch` and `forward`, which no calibration knows.

        Raises:
            InputError: as `load_calibration` and `from_projections`; a file that does not say how large images are.
        """
        from ndtorch.navigation.stereo.calibration_files import load_calibration  # cv2

        found = load_calibration(*paths, width=width, height=height, unit_m=unit_m, cameras=cameras)
        if found.size is None:
            raise InputError(f"{paths[0]} does not say how large the images are: give width and height of the frames")
        width, height = found.size
        return cls.from_projections(found.left.projection, found.right.projection, width, height, **where)

    @classmethod
    def from_projections(cls, left: Matrix, right: Matrix, width: int, height: int, **where: float) -> StereoRig:
        """The rig of a rectified pair, from the projection matrices of both cameras.

        So `cv2.stereoRectify` gives them as P1 and P2, ROS as `P` of both `camera_info`, and KITTI as `P0` and `P1`
        (grey) or `P2` and `P3` (color).

        Args:
            left, right: 3 x 4 numbers, the last column in pixels times metres, as rows or in one row of 12.
            width, height: size of a frame in pixels.
            where: `camera_height`, `pitch` and `forward`, which no calibration knows.

        Raises:
            InputError: matrices of another shape, or cameras that are not parallel, level and alike, or whose baseline
                cannot be.
        """
        p, q = (torch.as_tensor(matrix, dtype=torch.float64) for matrix in (left, right))
        if not p.numel() == q.numel() == 12 or not bool((p.sum() + q.sum()).isfinite()):
            raise InputError(f"expected two finite 3 x 4 matrices, got {tuple(p.shape)} and {tuple(q.shape)}")
        p, q = (matrix.reshape(3, 4) / matrix.reshape(3, 4)[2, 2] for matrix in (p, q))
        focal = float(p[0, 0])
        across = max(abs(float(p[1, 1]) - focal), float((p - q)[:, :3].abs().max()))
        if not (focal > 0 and across <= ALIKE * focal):
            raise InputError(
                f"both cameras must be rectified to one focal length and one axis (with OpenCV "
                f"CALIB_ZERO_DISPARITY); their matrices differ by {across:.3g} pixels"
            )
        apart = float(p[0, 3] - q[0, 3]) / focal
        if not apart > 0:
            raise InputError(f"the second matrix must be of the camera on the right, got a baseline of {apart:.3g} m")
        if apart > MAX_BASELINE:
            raise InputError(
                f"the cameras are {apart:.3g} m apart, more than {MAX_BASELINE:g} m: is the file in mm? Divide the "
                "last column by 1000 (unit_m=0.001 of load)"
            )
        return cls(apart, focal, width, height, cx=float(p[0, 2]), cy=float(p[1, 2]), **where)

    def __post_init__(self) -> None:
        check_numbers(self)
        if not min(self.baseline, self.focal, self.camera_height) > 0 or not abs(self.pitch) < math.pi / 2:
            raise InputError(f"expected baseline, focal and camera_height above 0 and |pitch| < pi / 2, got {self}")
        if max(self.width, self.height) > LONGEST_SIDE:
            raise InputError(f"width and height must be at most {LONGEST_SIDE}, got {self.width}x{self.height}")
        column, row = self.center
        if self.width < 8 or not (0 <= column <= self.width - 1 and 0 <= row <= self.height - 1):
            raise InputError(f"cx and cy must lie inside the frame, of 8 columns or more, got {self}")
        if not 0 <= self.row < self.height:
            raise InputError(f"the horizon must lie inside the frame; by pitch and focal it is in row {self.row}")

    def in_units(self, unit: float) -> StereoRig:
        """The rig with its lengths in units of so many metres."""
        lengths = {name: getattr(self, name) / unit for name in ("baseline", "camera_height", "forward")}
        return replace(self, **lengths)

    @property
    def row(self) -> int:
        """The row that sees the horizontal plane through the cameras: the center row where pitch is 0."""
        return math.floor(self.center[1] + 0.5 - self.focal * math.tan(self.pitch))

    @property
    def center(self) -> tuple[float, float]:
        """Column and row where the axes meet the frames."""
        column = (self.width - 1) / 2 if self.cx is None else self.cx
        return column, (self.height - 1) / 2 if self.cy is None else self.cy

    @cached_property
    def pixel_angle(self) -> float:
        """Angle of one pixel, radians: the least-squares slope of [A eq. A.4], 0.1212° for the rig of [A]."""
        p = self.pixel_position(torch.arange(self.width, dtype=torch.float64))
        return float((p * self.angle(p, "atan")).sum() / p.square().sum())

    def pixel_position(self, column: Tensor) -> Tensor:
        """Columns (0 is the leftmost) to positions p in pixels from the center, growing to the left.

        Unless `cx` says otherwise, the center lies between the two middle pixels of a row of even width.
        """
        return self.center[0] - column

    def angle(self, position: Tensor, model: AngleModel = "atan") -> Tensor:
        """Angle of the ray through pixel position p of the horizon row, radians, to the left positive.

        `"atan"` is the projection itself, `theta = atan(p / f)` [A eq. A.3]; `"linear"` its best straight
        line, `theta = p theta_pix` [A eq. A.4], which is up to 2.1° off and misplaces walls.
        """
        if model == "linear":
            return position * self.pixel_angle
        if model != "atan":
            raise InputError(f"angle model must be 'atan' or 'linear', got {model!r}")
        return torch.atan(position * (math.cos(self.pitch) / self.focal))

    def project(self, x: Tensor, y: Tensor, z: Tensor | float = 0.0) -> tuple[Tensor, Tensor]:
        """Column and row (pixel centers at whole numbers) at which one camera sees a point.

        Args:
            x, y, z: metres ahead of, to the left of and above that camera. Points not in front of it give
                meaningless places.
        """
        depth = x * math.cos(self.pitch) - z * math.sin(self.pitch)
        down = -x * math.sin(self.pitch) - z * math.cos(self.pitch)
        return self.center[0] - self.focal * y / depth, self.center[1] + self.focal * down / depth

    def subfields(
        self,
        near: float = 1.0,
        far: float = 1.5,
        inner: float = math.radians(4.0),
        outer: float = math.radians(15.0),
    ) -> tuple[Rect, Rect]:
        """Rectangles of the left and the right image that see the floor beside the path. [A §2.2, fig. 6]

        The floor between `near` and `far` metres ahead of the camera and between `inner` and `outer` radians
        outward of its axis (to the left in the left image) is projected and boxed. The two are mirror images about
        the column of the axes.

        Raises:
            InputError: when that floor is empty or not wholly inside the frame.
        """
        if not 0 < near < far < math.inf or not -math.pi / 2 < inner < outer < math.pi / 2:
            raise InputError(
                f"expected 0 < near < far and inner < outer, got near={near}, far={far}, inner={inner}, outer={outer}"
            )
        x = torch.tensor([near, near, far, far], dtype=torch.float64)
        bearing = torch.tensor([inner, outer, inner, outer], dtype=torch.float64)
        column, row = self.project(x, x * bearing.tan(), -self.camera_height)
        # Pixel n reaches from n - 1/2 to n + 1/2: every pixel whose center lies inside belongs to the box.
        top, left, begin = (math.ceil(float(part.min())) for part in (row, column, 2 * self.center[0] - column))
        bottom, right = math.floor(float(row.max())) + 1, math.floor(float(column.max())) + 1
        # Where the axes lie between two pixels, boxes of both images are still of one size.
        boxes = Rect(top, bottom, left, right), Rect(top, bottom, begin, begin + right - left)
        if not all(0 <= r.top < r.bottom <= self.height and 0 <= r.left < r.right <= self.width for r in boxes):
            raise InputError(
                f"the floor {near:g}-{far:g} m ahead projects to rows {top}-{bottom}, columns {left}-{right} "
                f"of {self.width}x{self.height} frames{self.floor_hint(near)}"
            )
        return boxes

    def floor_hint(self, near: float) -> str:
        """What to change so that floor is in view from this depth on, m; empty where it is in view."""
        down = math.atan((self.height - 1 - self.center[1]) / self.focal) + self.pitch  # of the lowest row
        if down <= 0:
            return "; no floor is in view: pitch the cameras farther down"
        nearest, most = self.camera_height / math.tan(down), near * math.tan(down)
        if down >= math.pi / 2 or nearest <= near:
            return ""
        mount = f"mount the cameras at most {most:.2f} m high, or pitch them farther down"
        return f"; the nearest floor in view is {nearest:.2f} m ahead: {mount}"
