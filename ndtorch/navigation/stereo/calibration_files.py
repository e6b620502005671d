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
from ndtorch.utils.files import read_bytes

Floats = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8]

FORMATS = "ROS camera_info or ost.yaml, KITTI or Middlebury calib.txt, EuRoC sensor.yaml, OpenCV, Kalibr"
MAX_BYTES, MAX_LISTS = 50_000, 500
PINHOLE = {"", "none", "plumb_bob", "rational_polynomial", "radtan", "radial-tangential", "radial_tangential"}
FISHEYE = {"equidistant", "fisheye", "kannala_brandt", "kannala_brandt4"}
"""Distortion models whose coefficients `cv2` and `cv2.fisheye` take as they are."""

ROS_MATRICES = ("K", "camera"), ("R", "rectification"), ("P", "projection")
OPENCV_NAMES = ("M{}", "K{}", "cameraMatrix{}"), ("D{}", "distCoeffs{}", "distortion{}")
"""Names of intrinsics and distortion of both cameras in the files of OpenCV's sample and of others."""


class PairCamera(NamedTuple):
    """One camera of a pair."""

    matrix: Floats  # intrinsics `[3, 3]`, pixels
    distortion: Floats  # coefficients `[n]` as OpenCV has them
    rotation: Floats  # from the camera's frame to that of the rectified pair, `[3, 3]`
    projection: Floats  # of the rectified camera, `[3, 4]`, the last column in pixels times metres
    fisheye: bool = False  # coefficients are those of `cv2.fisheye`

    def maps(self, matrix: Floats, size: tuple[int, int]) -> Any:
        """Columns and rows of the raw image of each pixel of a rectified one of this size and these intrinsics."""
        made = cv2.fisheye if self.fisheye else cv2
        return made.initUndistortRectifyMap(self.matrix, self.distortion, self.rotation, matrix, size, cv2.CV_32FC1)


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
            if camera.fisheye and camera.distortion.size != 4:
                raise InputError(f"a fisheye lens has 4 coefficients of distortion, got {camera.distortion.size}")
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
        return [camera.maps(camera.projection[:, :3], self.size) for camera in (self.left, self.right)]

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
    given = None if width is None or height is None else (width, height)
    try:
        tables = [parsed(read_bytes(path, MAX_BYTES).decode(errors="replace")) for path in paths]
        pair = of_tables(tables, cameras, unit_m, given)
    except OSError as error:
        raise InputError(f"{names}: cannot be read ({error.strerror})") from None
    except InputError as error:
        raise InputError(f"{names}: {error}") from None
    except (LookupError, ValueError, TypeError, AttributeError, RecursionError, cv2.error) as error:
        raise InputError(f"{names}: no calibration that is known ({FORMATS}): {' '.join(str(error).split())}") from None
    if given and pair.size not in (None, given):
        raise InputError(f"{names}: the calibration is for {pair.size} images and the frames are {given}")
    return replace(pair, size=given or pair.size)


def of_tables(
    tables: list[dict[str, Any]], cameras: tuple[int, int], unit: float, given: tuple[int, int] | None
) -> StereoCalibration:
    """The pair in one table of KITTI or Kalibr, in one or two of OpenCV, or in two of ROS or EuRoC."""
    left, right = tables[0], tables[-1]
    both, matrices = left | right, [name for name in left if name[:1] == "P" and array(left[name]).size == 12]
    singles = [bool({"K", "k", "camera_matrix", "T_BS"} & table.keys()) for table in tables]
    if singles == [True, True] and "T_BS" not in both:
        return ros_pair(left, right, unit)
    if len(tables) == 1 and not {"R", "T", "M1"} & left.keys() and len(matrices) > max(cameras):
        projections = (array(left[matrices[n]]).reshape(3, 4) for n in cameras)
        pair = [PairCamera(p[:, :3], np.zeros(5), np.eye(3), p * (1, 1, 1, unit)) for p in projections]
        return StereoCalibration(pair[0], pair[1], image_size(left) if "image_width" in left else None)
    if {"cam0", "cam1", "baseline"} <= left.keys():  # Middlebury: rectified but for `doffs`; the baseline in mm
        k0, k1 = (array(left[f"cam{n}"]).reshape(3, 3) for n in (0, 1))
        p0 = np.column_stack((k0, np.zeros(3)))
        p1 = np.column_stack((k0, (-k0[0, 0] * float(left["baseline"]) / 1000, 0, 0)))
        pair = [PairCamera(k, np.zeros(5), np.eye(3), p) for k, p in ((k0, p0), (k1, p1))]
        return StereoCalibration(pair[0], pair[1], image_size(left))
    if len(tables) == 2 and all("T_BS" in table for table in tables):
        poses = [array(one["T_BS"]).reshape(4, 4) for one in tables]
        motion = np.linalg.inv(poses[1]) @ poses[0]
    elif all(f"cam{n}" in left for n in cameras):
        motion = np.eye(4)
        for n in range(cameras[0] + 1, cameras[1] + 1):
            motion = array(left[f"cam{n}"]["T_cn_cnm1"]).reshape(4, 4) @ motion
        left, right = (tables[0][f"cam{n}"] for n in cameras)
    elif any(singles):
        raise InputError("one camera of a pair: give the files of both cameras, of one format, the left one first")
    elif {"R", "T"} & both.keys() or any(name.format(1) in both for name in OPENCV_NAMES[0]):
        return of_opencv(both, unit, given)
    else:
        raise ValueError(f"it has {', '.join(map(str, both))[:60] or 'nothing'}")
    fisheye = is_fisheye(left)
    if fisheye != is_fisheye(right):
        raise InputError("both cameras must have the same distortion model")
    lenses = []
    for camera in (left, right):
        fu, fv, cu, cv = array(camera["intrinsics"])
        matrix = np.array([[fu, 0, cu], [0, fv, cv], [0, 0, 1]])
        lenses += [matrix, array(pick(camera, "distortion_coefficients", "distortion_coeffs"))]
    size = one_size(left["resolution"], right["resolution"])
    return stereo_calibration(lenses[::2], lenses[1::2], motion[:3, :3], motion[:3, 3] * unit, size, fisheye)


def of_opencv(table: Mapping[str, Any], unit: float, given: tuple[int, int] | None) -> StereoCalibration:
    """The pair of `cv2.stereoCalibrate`, rectified as the file says, or else by `cv2.stereoRectify`."""
    matrices, distortions = (
        [array(pick(table, *(name.format(n) for name in names))) for n in (1, 2)] for names in OPENCV_NAMES
    )
    k1, k2 = (matrix.reshape(3, 3) for matrix in matrices)
    size = image_size(table) if "image_width" in table else given
    if all(name in table for name in ("R1", "R2", "P1", "P2")):
        turns = [array(table[f"R{n}"]).reshape(3, 3) for n in (1, 2)]
        first, second = (array(table[f"P{n}"]).reshape(3, 4) * (1, 1, 1, unit) for n in (1, 2))
        left = PairCamera(k1, distortions[0], turns[0], first)
        return StereoCalibration(left, PairCamera(k2, distortions[1], turns[1], second), size)
    turn, shift = array(pick(table, "R")).reshape(3, 3), array(pick(table, "T")) * unit
    if size is None:
        raise InputError("the file does not say how large the images are: give width and height of the frames")
    return stereo_calibration([k1, k2], distortions, turn, shift, size)


def ros_pair(left: Mapping[str, Any], right: Mapping[str, Any], unit: float = 1.0) -> StereoCalibration:
    """The pair of two camera_info messages or ost.yaml files, as binning and region of interest leave it (REP 104)."""
    cameras, sizes = [], []
    for table in (left, right):
        k, r, p = (array(pick(table, f"{name}_matrix", short, short.lower())) for short, name in ROS_MATRICES)
        d, region = array(pick(table, "distortion_coefficients", "D", "d")), table.get("roi") or {}
        bins = np.array([max(1, int(table.get(f"binning_{axis}", 1))) for axis in "xy"])
        x, y, *shape = (int(region.get(name, 0)) for name in ("x_offset", "y_offset", "width", "height"))
        sizes.append(np.where(all(shape), shape, image_size(table)) // bins)
        view = np.diag([*(1 / bins), 1]) @ [[1, 0, -x], [0, 1, -y], [0, 0, 1]]
        p = p.reshape(3, 4) * (1, 1, 1, unit)
        cameras.append(PairCamera(view @ k.reshape(3, 3), d, r.reshape(3, 3), view @ p, is_fisheye(table)))
    return StereoCalibration(cameras[0], cameras[1], one_size(*sizes))


def stereo_calibration(
    matrices: Sequence[Floats],
    distortions: Sequence[Floats],
    turn: Floats,
    shift: Floats,
    size: tuple[int, int],
    fisheye: bool = False,
) -> StereoCalibration:
    """A pair as `cv2.stereoCalibrate` measures it.

    Args:
        matrices, distortions: intrinsics `[3, 3]` and coefficients `[n]` of the left and the right camera.
        turn, shift: from the left camera's frame to the right one's, `[3, 3]` and `[3]` in metres.
        size: width and height of the images, pixels.
        fisheye: whether the coefficients are those of `cv2.fisheye`.
    """
    lenses = (matrices[0], distortions[0], matrices[1], distortions[1])
    rectify: Any = cv2.fisheye.stereoRectify if fisheye else cv2.stereoRectify
    options = {"flags": cv2.STEREO_ZERO_DISPARITY} | ({} if fisheye else {"alpha": 0})
    r1, r2, p1, p2 = (
        np.asarray(m, np.float64) for m in rectify(*lenses, size, turn, shift.reshape(3, 1), **options)[:4]
    )
    first, second = PairCamera(*lenses[:2], r1, p1, fisheye), PairCamera(*lenses[2:], r2, p2, fisheye)
    return StereoCalibration(first, second, size)


def is_fisheye(camera: Mapping[str, Any]) -> bool:
    """Whether the distortion of a camera is that of `cv2.fisheye`; raises `InputError` for models of other kinds."""
    model, lens = str(camera.get("distortion_model", "")).lower(), str(camera.get("camera_model", "pinhole"))
    if model not in PINHOLE | FISHEYE or lens != "pinhole":
        raise InputError(f"the model {lens} {model} is not supported: calibrate with radtan or equidistant")
    return model in FISHEYE


def image_size(table: Mapping[str, Any]) -> tuple[int, int]:
    return int(pick(table, "image_width", "width")), int(pick(table, "image_height", "height"))


def one_size(left: Any, right: Any) -> tuple[int, int]:
    if tuple(left) != tuple(right) or not min(left) > 0:
        raise InputError(f"both cameras must have images of one size, got {left} and {right}")
    return int(left[0]), int(left[1])


def pick(table: Mapping[str, Any], *names: str) -> Any:
    """The value of the first of some names that a table has."""
    if not any(name in table for name in names):
        raise InputError(f"{' or '.join(names)} is missing")
    return table[next(name for name in names if name in table)]


def array(value: Any) -> Floats:
    """The numbers of a list, of a text, or of a matrix that has them under `data`, in one row."""
    value = value["data"] if isinstance(value, Mapping) else value
    return np.array(re.sub("[,;]", " ", value).split() if isinstance(value, str) else value, np.float64).ravel()


def parsed(text: str) -> dict[str, Any]:
    """The first table of a YAML file: names with numbers, lists or matrices; or lines of twelve numbers as P0, P1...

    Of XML the numbers between tags are read, of Middlebury's lines `name=[1 2; 3 4]`.
    """
    from ruamel.yaml import YAML, AliasEvent
    from ruamel.yaml.error import YAMLError

    reader = YAML(typ="safe", pure=True)
    reader.Constructor.add_constructor(
        "tag:yaml.org,2002:opencv-matrix", lambda constructor, node: constructor.construct_mapping(node, deep=True)
    )
    text = re.sub(r"^\s*%YAML.*\n", "", text.removeprefix("\ufeff")).expandtabs(1)
    if sum(map(text.count, "[{<")) > MAX_LISTS:
        raise ValueError(f"more than {MAX_LISTS} lists")
    if "<opencv_storage>" in text:
        found: dict[str, Any] = dict(re.findall(r"<(\w+)>([^<>]+)</\1>", text))
        matrices = re.findall(r"<(\w+) type_id=\"opencv-matrix\">(.*?)</\1>", text, re.DOTALL)
        return found | {name: re.findall("<data>([^<>]*)", inside)[0] for name, inside in matrices}
    text = re.sub(r"^(\w+)=\[?([^]\n]*)\]?", r"\1: \2", text, flags=re.MULTILINE)
    try:
        if any(isinstance(event, AliasEvent) for event in reader.parse(text)):  # a small file of them holds any number
            raise ValueError("references are not read")
        table = next(iter(reader.load_all(text)), None)
    except YAMLError as error:
        raise ValueError(f"not a YAML file ({str(error).splitlines()[0]})") from None
    if isinstance(table, str):
        table = {f"P{n}": row for n, row in enumerate(array(table).reshape(-1, 12))}
    if not isinstance(table, dict):
        raise ValueError("not a table of names and values")
    return table
