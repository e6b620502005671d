"""Calibrations of stereo pairs that others have made: ROS, KITTI, EuRoC, Middlebury, OpenCV, Kalibr."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError

Floats = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

FORMATS = "ROS camera_info or ost.yaml, KITTI calib.txt, EuRoC sensor.yaml, Middlebury calib.txt, OpenCV, Kalibr"

PINHOLE = {"", "none", "plumb_bob", "rational_polynomial", "radtan", "radial-tangential", "radial_tangential"}
"""Distortion models whose coefficients OpenCV takes as they are."""


class PairCamera(NamedTuple):
    """One camera of a pair.

    Attributes:
        matrix: intrinsics `[3, 3]`, pixels.
        distortion: coefficients `[n]` as OpenCV has them.
        rotation: from the camera's frame to that of the rectified pair, `[3, 3]`.
        projection: of the rectified camera, `[3, 4]`, the last column in pixels times metres.
    """

    matrix: Floats
    distortion: Floats
    rotation: Floats
    projection: Floats


class StereoCalibration:
    """A calibrated pair: its geometry once rectified, and what rectifies its images.

    Args:
        left, right: the cameras.
        size: width and height of the images, pixels; None where the file does not say.
    """

    def __init__(self, left: PairCamera, right: PairCamera, size: tuple[int, int] | None) -> None:
        self.left, self.right, self.size = left, right, size

    @property
    def is_rectified(self) -> bool:
        """Whether images come rectified, so that `rectify` leaves them as they are."""
        return all(
            not camera.distortion.any()
            and np.allclose(camera.rotation, np.eye(3), atol=1e-9)
            and np.allclose(camera.matrix, camera.projection[:, :3], atol=1e-3)
            for camera in (self.left, self.right)
        )

    def resized(self, width: int, height: int) -> StereoCalibration:
        """The calibration of the same images scaled to another size."""
        if self.size is None or self.size == (width, height):
            return StereoCalibration(self.left, self.right, (width, height))
        across, down = width / self.size[0], height / self.size[1]
        # Pixel centers are at whole numbers: the border of the image is at -1/2.
        scale = np.array([[across, 0, (across - 1) / 2], [0, down, (down - 1) / 2], [0, 0, 1]])
        left, right = (
            camera._replace(matrix=scale @ camera.matrix, projection=scale @ camera.projection)
            for camera in (self.left, self.right)
        )
        return StereoCalibration(left, right, (width, height))

    @cached_property
    def maps(self) -> list[tuple[Any, Any]]:
        """Where each pixel of the rectified images lies in the raw ones."""
        import cv2

        if self.size is None:
            raise InputError("the calibration does not say how large the images are: give width and height")
        return [
            cv2.initUndistortRectifyMap(
                camera.matrix, camera.distortion, camera.rotation, camera.projection[:, :3], self.size, cv2.CV_32FC1
            )
            for camera in (self.left, self.right)
        ]

    def rectify(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Both images `[H, W]` or `[H, W, C]` as parallel cameras would have taken them.

        Raises:
            InputError: images of another size than the calibration's.
        """
        import cv2

        for image in (left, right):
            if self.size is not None and image.shape[1::-1] != self.size:
                raise InputError(f"the calibration is for {self.size} images, got {image.shape[1::-1]}")
        if self.is_rectified:
            return left, right
        made = [cv2.remap(image, *maps, cv2.INTER_LINEAR) for image, maps in zip((left, right), self.maps, strict=True)]
        return made[0], made[1]  # type: ignore[return-value]


def load_calibration(
    *paths: str | Path,
    width: int | None = None,
    height: int | None = None,
    rescale: bool = False,
    unit_m: float | None = None,
    cameras: tuple[int, int] = (0, 1),
) -> StereoCalibration:
    """The calibration in one file of both cameras, or in two files, the left camera first.

    Args:
        paths: ROS camera_info or ost.yaml, KITTI calib.txt, EuRoC sensor.yaml, Middlebury calib.txt, OpenCV
            FileStorage (yml, xml) or Kalibr camchain.
        width, height: of the frames, pixels, where the file does not say or to check what it says.
        rescale: The calibration is scaled where the frames have another size.
        unit_m: Lengths of the file are so many metres; 0.001 for Middlebury, which has mm, else 1.
        cameras: numbers of the left and the right camera in a file of KITTI or Kalibr that has more.

    Raises:
        InputError: a file that cannot be read or is none of these; another size than the frames.
    """
    if len(paths) not in (1, 2):
        raise InputError(f"expected one calibration file of both cameras or two, got {len(paths)}")
    texts = [read(Path(path)) for path in paths]
    where = ", ".join(map(str, paths))
    try:
        found = of_one(texts[0], cameras, unit_m) if len(texts) == 1 else of_two(texts, unit_m)
    except (KeyError, ValueError, TypeError, IndexError, AttributeError) as error:
        raise InputError(f"{where}: no calibration that is known ({FORMATS}): {error}") from None
    if (width is None) != (height is None):
        raise InputError("give width and height together")
    if width is None or height is None:
        return found
    if found.size is not None and found.size != (width, height) and not rescale:
        raise InputError(
            f"{where}: the calibration is for {found.size[0]}x{found.size[1]} images and the frames are "
            f"{width}x{height}; rescale=True scales it, where the frames are scaled images and not cut ones"
        )
    return found.resized(width, height)


def read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or 'not a text file'})") from None


def of_one(text: str, cameras: tuple[int, int], unit_m: float | None) -> StereoCalibration:
    if re.search(r"^\s*cam0\s*=", text, re.MULTILINE):
        return middlebury(text, 0.001 if unit_m is None else unit_m)
    unit = 1.0 if unit_m is None else unit_m
    lines = [numbers(line) for line in text.splitlines()]
    rows = [row for row in lines if row is not None]
    if rows and len(rows) > max(cameras):
        left, right = (projected(rows[n], unit) for n in cameras)
        return StereoCalibration(left, right, None)
    values = parsed(text)
    names = [f"cam{n}" for n in cameras]
    if all(name in values for name in names):
        first, second = (values[name] for name in names)
        chain = np.eye(4)
        for n in range(cameras[0] + 1, cameras[1] + 1):
            chain = np.array(values[f"cam{n}"]["T_cn_cnm1"], np.float64).reshape(4, 4) @ chain
        return rectified(first, second, chain, unit)
    return opencv(values, unit)


def of_two(texts: Sequence[str], unit_m: float | None) -> StereoCalibration:
    unit = 1.0 if unit_m is None else unit_m
    left, right = map(parsed, texts)
    if "T_BS" in left:
        bodies = [np.array(matrix_of(one["T_BS"]), np.float64).reshape(4, 4) for one in (left, right)]
        return rectified(left, right, np.linalg.inv(bodies[1]) @ bodies[0], unit)
    first, second = (of_ros(one, unit) for one in (left, right))
    sizes = [
        (int(one.get("image_width", one.get("width", 0))), int(one.get("image_height", one.get("height", 0))))
        for one in (left, right)
    ]
    if sizes[0] != sizes[1] or not min(sizes[0]) > 0:
        raise InputError(f"both cameras must have images of one size, got {sizes[0]} and {sizes[1]}")
    return StereoCalibration(first, second, sizes[0])


def of_ros(values: Mapping[str, Any], unit: float) -> PairCamera:
    """A camera of a camera_info message or of an ost.yaml."""

    def entry(*names: str) -> Any:
        return matrix_of(next(values[name] for name in names if name in values))

    check_model(values)
    try:
        projection = shaped(entry("projection_matrix", "P", "p"))
        projection[:, 3] *= unit
        matrix, turn = (
            np.array(entry(*names), np.float64).reshape(3, 3)
            for names in (("camera_matrix", "K", "k"), ("rectification_matrix", "R", "r"))
        )
        bent = np.array(entry("distortion_coefficients", "D", "d"), np.float64).ravel()
    except StopIteration:
        raise ValueError(
            "expected camera_matrix, distortion_coefficients, rectification_matrix and projection_matrix"
        ) from None
    return PairCamera(matrix, bent, turn, projection)


def check_model(camera: Mapping[str, Any]) -> None:
    model = str(camera.get("distortion_model", ""))
    if model.lower() not in PINHOLE:
        raise InputError(f"distortion_model {model!r} is not supported: calibrate with a pinhole model (radtan)")


def rectified(left: Any, right: Any, motion: Floats, unit: float) -> StereoCalibration:
    """A pair of intrinsics, and the motion `[4, 4]` from the left camera's frame to the right one's."""
    matrices, bends, sizes = [], [], []
    for camera in (left, right):
        check_model(camera)
        if str(camera.get("camera_model", "pinhole")) != "pinhole":
            raise InputError(f"camera_model {camera['camera_model']!r} is not supported: calibrate as pinhole")
        fu, fv, cu, cv = map(float, camera["intrinsics"])
        matrices.append(np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]]))
        bends.append(np.array(camera.get("distortion_coefficients", camera.get("distortion_coeffs")), np.float64))
        sizes.append((int(camera["resolution"][0]), int(camera["resolution"][1])))
    if sizes[0] != sizes[1]:
        raise InputError(f"both cameras must have images of one size, got {sizes[0]} and {sizes[1]}")
    return by_opencv(matrices, bends, motion[:3, :3], motion[:3, 3] * unit, sizes[0])


def by_opencv(
    matrices: Sequence[Floats], bends: Sequence[Floats], turn: Floats, shift: Floats, size: tuple[int, int]
) -> StereoCalibration:
    import cv2

    turns_projections = cv2.stereoRectify(
        *(matrices[0], bends[0], matrices[1], bends[1], size, turn, np.reshape(shift, (3, 1))),
        flags=cv2.STEREO_ZERO_DISPARITY,
        alpha=0,
    )
    r1, r2, p1, p2 = (np.asarray(part, np.float64) for part in turns_projections[:4])
    return StereoCalibration(PairCamera(matrices[0], bends[0], r1, p1), PairCamera(matrices[1], bends[1], r2, p2), size)


OPENCV = {
    "left": ("M1", "K1", "cameraMatrix1", "camera_matrix_1", "left_camera_matrix"),
    "right": ("M2", "K2", "cameraMatrix2", "camera_matrix_2", "right_camera_matrix"),
    "bend_left": ("D1", "distCoeffs1", "dist_coeffs_1", "left_distortion_coefficients"),
    "bend_right": ("D2", "distCoeffs2", "dist_coeffs_2", "right_distortion_coefficients"),
    "turn": ("R", "rotation"),
    "shift": ("T", "translation"),
}
"""Names under which samples and tools write what `cv2.stereoCalibrate` gives."""


def opencv(values: Mapping[str, Any], unit: float) -> StereoCalibration:
    size = None
    for width, height in (("image_width", "image_height"), ("width", "height")):
        if width in values and height in values:
            size = (int(values[width]), int(values[height]))
    for name in ("imageSize", "image_size", "size"):
        if name in values:
            size = (int(values[name][0]), int(values[name][1]))
    found = {part: next((values[n] for n in names if n in values), None) for part, names in OPENCV.items()}
    if all(part is not None for part in found.values()) and size is not None:
        left, right, bend_left, bend_right, turn, shift = (np.array(matrix_of(part)) for part in found.values())
        matrices, bends = [left.reshape(3, 3), right.reshape(3, 3)], [bend_left.ravel(), bend_right.ravel()]
        return by_opencv(matrices, bends, turn.reshape(3, 3), shift.ravel() * unit, size)
    if "P1" in values and "P2" in values:
        first, second = (projected(matrix_of(values[name]), unit) for name in ("P1", "P2"))
        return StereoCalibration(first, second, size)
    raise ValueError("expected M1, D1, M2, D2, R, T and the image size, or P1 and P2")


def middlebury(text: str, unit: float) -> StereoCalibration:
    values = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)
    pair = []
    size = (int(values["width"]), int(values["height"]))
    for number in (0, 1):
        rows = values[f"cam{number}"].strip().strip("[]").replace(";", " ")
        pair.append(np.array(rows.split(), np.float64).reshape(3, 3))
    shift = np.zeros((3, 1))
    flat, still = np.zeros(5), np.eye(3)
    moved = shift.copy()
    moved[0] = -pair[0][0, 0] * float(values["baseline"]) * unit
    # Where the axes meet other columns, the right images are shifted by doffs: both then have the left camera's axis.
    left, right = (np.hstack((pair[0], part)) for part in (shift, moved))
    return StereoCalibration(PairCamera(pair[0], flat, still, left), PairCamera(pair[1], flat, still, right), size)


def projected(values: Sequence[float] | Floats, unit: float) -> PairCamera:
    """A camera whose images are rectified, from its projection matrix."""
    projection = shaped(values)
    projection[:, 3] *= unit
    return PairCamera(projection[:, :3].copy(), np.zeros(5), np.eye(3), projection)


def shaped(values: Any) -> Floats:
    """A projection matrix `[3, 4]` from 12 numbers."""
    matrix = np.array(values, np.float64)
    if matrix.size != 12 or not np.isfinite(matrix).all():
        raise InputError(f"a projection matrix has 12 finite numbers, got {matrix.size}")
    return matrix.reshape(3, 4)


def matrix_of(value: Any) -> Any:
    """The numbers of a matrix that may stand under `data`."""
    return value["data"] if isinstance(value, Mapping) else value


def numbers(line: str) -> list[float] | None:
    """The 12 numbers of a line of KITTI, with or without a name before them."""
    words = re.sub(r"^\s*P\w*:", "", line).split()
    try:
        row = [float(word) for word in words]
    except ValueError:
        return None
    return row if len(row) == 12 and all(map(math.isfinite, row)) else None


def parsed(text: str) -> dict[str, Any]:
    """A YAML or XML file as OpenCV reads it."""
    import cv2

    if not text.lstrip().startswith(("<?xml", "%YAML")):
        text = f"%YAML:1.0\n---\n{text.removeprefix('---')}"
    if not text.lstrip().startswith("<?xml"):
        # It wants lists to be further in than their name.
        text = re.sub(r"(?m)^(\s*)- ", r"\1  - ", text)
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        return {key: node_value(root.getNode(key)) for key in root.keys()}  # noqa: SIM118
    except (cv2.error, SystemError) as error:
        raise ValueError(f"not a YAML or XML file that OpenCV reads ({str(error).splitlines()[0][:80]})") from None


def node_value(node: Any) -> Any:
    if node.isSeq():
        return [node_value(node.at(n)) for n in range(node.size())]
    if node.isMap():
        return {key: node_value(node.getNode(key)) for key in node.keys()}  # noqa: SIM118
    return node.string() if node.isString() else node.real()
