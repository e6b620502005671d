"""Calibrations of stereo pairs in the formats of ROS, KITTI, EuRoC, OpenCV and Kalibr."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError
from ndtorch.utils.files import read_text

Floats = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

FORMATS = "ROS camera_info or ost.yaml, KITTI calib.txt, EuRoC sensor.yaml, OpenCV, Kalibr"
MAX_BYTES = 50_000
PINHOLE = {"", "none", "plumb_bob", "rational_polynomial", "radtan", "radial-tangential", "radial_tangential"}
"""Distortion models whose coefficients OpenCV takes as they are."""

ROS_MATRICES = ("K", "camera"), ("R", "rectification"), ("P", "projection")


class PairCamera(NamedTuple):
    """One camera of a pair."""

    matrix: Floats  # intrinsics `[3, 3]`, pixels
    distortion: Floats  # coefficients `[n]` as OpenCV has them
    rotation: Floats  # from the camera's frame to that of the rectified pair, `[3, 3]`
    projection: Floats  # of the rectified camera, `[3, 4]`, the last column in pixels times metres


@dataclass(frozen=True)
class StereoCalibration:
    """A calibrated pair: its geometry once rectified, and what rectifies its images.

    Args:
        left, right: the cameras.
        size: width and height of the images, pixels; None where the file does not say.
    """

    left: PairCamera
    right: PairCamera
    size: tuple[int, int] | None

    def __post_init__(self) -> None:
        for camera in (self.left, self.right):
            if not all(np.isfinite(part).all() for part in camera):
                raise InputError("a calibration must consist of finite numbers")
            if min(matrix[i, i] for matrix in (camera.matrix, camera.projection) for i in (0, 1)) <= 0:
                raise InputError("focal lengths must be positive")

    @property
    def is_rectified(self) -> bool:
        """Whether images come rectified, so that `rectify` leaves them as they are."""
        return all(
            not camera.distortion.any()
            and np.allclose(camera.rotation, np.eye(3), atol=1e-9)
            and np.allclose(camera.matrix, camera.projection[:, :3], atol=1e-3)
            for camera in (self.left, self.right)
        )

    @cached_property
    def maps(self) -> list[Any]:
        """Position in the raw images of each pixel of the rectified ones."""
        if self.size is None:
            raise InputError("the calibration does not say how large the images are: give width and height")
        return [
            cv2.initUndistortRectifyMap(matrix, distortion, rotation, projection[:, :3], self.size, cv2.CV_32FC1)
            for matrix, distortion, rotation, projection in (self.left, self.right)
        ]

    def rectify(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Both images `[H, W]` or `[H, W, C]` as parallel cameras would have taken them.

        Raises:
            InputError: images of another size than the calibration's.
        """
        for image in (left, right):
            if self.size is not None and image.shape[1::-1] != self.size:
                raise InputError(f"the calibration is for {self.size} images, got {image.shape[1::-1]}")
        if self.is_rectified:
            return left, right
        first, second = (
            np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR), np.uint8)
            for image, (x, y) in zip((left, right), self.maps, strict=True)
        )
        return first, second


def load_calibration(
    *paths: str | Path,
    width: int | None = None,
    height: int | None = None,
    unit_m: float = 1.0,
    cameras: tuple[int, int] = (0, 1),
) -> StereoCalibration:
    """The calibration in one file of both cameras, or in two files, the left camera first.

    Args:
        paths: ROS camera_info or ost.yaml, KITTI calib.txt, EuRoC sensor.yaml, OpenCV FileStorage (yml with M1, D1,
            M2, D2, R, T and image_width, image_height, or with P1 and P2) or Kalibr camchain.
        width, height: of the frames, pixels, where the file does not say or to check what it says.
        unit_m: Lengths of the file are so many metres; 0.001 for mm.
        cameras: numbers of the left and the right camera in a file of KITTI or Kalibr that has more.

    Raises:
        InputError: a file that cannot be read or is none of these; another size than the frames.
    """
    if len(paths) not in (1, 2) or (width is None) != (height is None):
        raise InputError("expected one calibration file of both cameras or two, and width and height together")
    names = ", ".join(map(str, paths))
    try:
        texts = [read_text(path, MAX_BYTES).removeprefix("\ufeff") for path in paths]
        pair = of_lines(texts[0], cameras, unit_m) if len(texts) == 1 else None
        pair = pair or of_tables([parsed(text) for text in texts], cameras, unit_m)
    except OSError as error:
        raise InputError(f"{names}: cannot be read ({error.strerror})") from None
    except InputError as error:
        raise InputError(f"{names}: {error}") from None
    except (LookupError, ValueError, TypeError, AttributeError, RecursionError, cv2.error) as error:
        raise InputError(f"{names}: no calibration that is known ({FORMATS}): {error}") from None
    if width is None or height is None:
        return pair
    if pair.size not in (None, (width, height)):
        raise InputError(f"{names}: the calibration is for {pair.size} images and the frames are {(width, height)}")
    return replace(pair, size=(width, height))


def of_lines(text: str, cameras: tuple[int, int], unit: float) -> StereoCalibration | None:
    """The pair in lines of a name and twelve numbers, as of KITTI; None for other files."""
    rows = re.findall(r"^(?:P[^:\n]*:)?[ \t]*([-+.\deE]+(?:[ \t]+[-+.\deE]+){11})[ \t]*$", text, re.MULTILINE)
    if len(rows) <= max(cameras):
        return None
    first, second = (rectified_camera(np.array(rows[n].split(), np.float64).reshape(3, 4), unit) for n in cameras)
    return StereoCalibration(first, second, None)


def of_tables(tables: list[dict[str, Any]], cameras: tuple[int, int], unit: float) -> StereoCalibration:
    """The pair in one table of OpenCV or Kalibr, or in two of ROS or EuRoC."""
    left, right = tables[0], tables[-1]
    if len(tables) == 2 and "T_BS" not in left:
        return StereoCalibration(ros_camera(left, unit), ros_camera(right, unit), one_size(*map(image_size, tables)))
    if len(tables) == 2:
        poses = [array(one["T_BS"]).reshape(4, 4) for one in tables]
        motion = np.linalg.inv(poses[1]) @ poses[0]
    elif all(f"cam{n}" in left for n in cameras):
        motion = np.eye(4)
        for n in range(cameras[0] + 1, cameras[1] + 1):
            motion = array(left[f"cam{n}"]["T_cn_cnm1"]).reshape(4, 4) @ motion
        left, right = (tables[0][f"cam{n}"] for n in cameras)
    else:
        return of_opencv(left, unit)
    matrices, distortions = [], []
    for camera in (left, right):
        check_model(camera)
        fu, fv, cu, cv = array(camera["intrinsics"])
        matrices.append(np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]]))
        distortions.append(array(pick(camera, "distortion_coefficients", "distortion_coeffs")))
    size = one_size(left["resolution"], right["resolution"])
    return stereo_calibration(matrices, distortions, motion[:3, :3], motion[:3, 3] * unit, size)


def of_opencv(table: Mapping[str, Any], unit: float) -> StereoCalibration:
    size = image_size(table) if "image_width" in table else None
    if "P1" in table and "P2" in table and "R" not in table:
        first, second = (rectified_camera(array(table[name]).reshape(3, 4), unit) for name in ("P1", "P2"))
        return StereoCalibration(first, second, size)
    if size is None:
        raise ValueError("expected M1, D1, M2, D2, R, T, image_width and image_height, or P1 and P2")
    matrices, distortions = ([array(table[f"{name}{n}"]) for n in (1, 2)] for name in "MD")
    turn, shift = array(table["R"]).reshape(3, 3), array(table["T"]) * unit
    return stereo_calibration([matrix.reshape(3, 3) for matrix in matrices], distortions, turn, shift, size)


def ros_camera(table: Mapping[str, Any], unit: float) -> PairCamera:
    """A camera of a camera_info message or of an ost.yaml."""
    check_model(table)
    k, r, p = (array(pick(table, f"{name}_matrix", short, short.lower())) for short, name in ROS_MATRICES)
    d = array(pick(table, "distortion_coefficients", "D", "d"))
    return PairCamera(k.reshape(3, 3), d, r.reshape(3, 3), p.reshape(3, 4) * (1, 1, 1, unit))


def stereo_calibration(
    matrices: Sequence[Floats], distortions: Sequence[Floats], turn: Floats, shift: Floats, size: tuple[int, int]
) -> StereoCalibration:
    """A pair as `cv2.stereoCalibrate` measures it.

    Args:
        matrices, distortions: intrinsics `[3, 3]` and coefficients `[n]` of the left and the right camera.
        turn, shift: from the left camera's frame to the right one's, `[3, 3]` and `[3]` in metres.
        size: width and height of the images, pixels.
    """
    lenses = (matrices[0], distortions[0], matrices[1], distortions[1])
    made = cv2.stereoRectify(*lenses, size, turn, shift.reshape(3, 1), flags=cv2.STEREO_ZERO_DISPARITY, alpha=0)
    r1, r2, p1, p2 = (np.asarray(part, np.float64) for part in made[:4])
    return StereoCalibration(PairCamera(*lenses[:2], r1, p1), PairCamera(*lenses[2:], r2, p2), size)


def rectified_camera(projection: Floats, unit: float) -> PairCamera:
    """A camera whose images are rectified, from its projection matrix `[3, 4]`."""
    return PairCamera(projection[:, :3], np.zeros(5), np.eye(3), projection * (1, 1, 1, unit))


def check_model(camera: Mapping[str, Any]) -> None:
    model, lens = str(camera.get("distortion_model", "")), str(camera.get("camera_model", "pinhole"))
    if model.lower() not in PINHOLE or lens != "pinhole":
        raise InputError(f"the model {lens} {model} is not supported: calibrate with a pinhole model (radtan)")


def image_size(table: Mapping[str, Any]) -> tuple[int, int]:
    return int(pick(table, "image_width", "width")), int(pick(table, "image_height", "height"))


def one_size(left: Any, right: Any) -> tuple[int, int]:
    if tuple(left) != tuple(right) or not min(left) > 0:
        raise InputError(f"both cameras must have images of one size, got {left} and {right}")
    return int(left[0]), int(left[1])


def pick(table: Mapping[str, Any], *names: str) -> Any:
    """The value of the first of some names that a table has."""
    return table[next((name for name in names if name in table), names[0])]


def array(value: Any) -> Floats:
    """The numbers of a list, or of a matrix that has them under `data`, in one row."""
    return np.array(value["data"] if isinstance(value, Mapping) else value, np.float64).ravel()


def parsed(text: str) -> dict[str, Any]:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    reader = YAML(typ="safe", pure=True)
    reader.Constructor.add_constructor(
        "tag:yaml.org,2002:opencv-matrix", lambda constructor, node: constructor.construct_mapping(node, deep=True)
    )
    try:
        table = next(iter(reader.load_all(re.sub(r"^\s*%YAML.*\n", "", text))), None)
    except YAMLError as error:
        raise ValueError(f"not a YAML file ({str(error).splitlines()[0]})") from None
    if not isinstance(table, dict):
        raise ValueError("not a table of names and values")
    return table
