"""Pixels, angles and floor rectangles, against the published numbers and hand geometry."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Navigator, Rect, StereoRanging, StereoRig
from ndtorch.navigation.stereo.calibration_files import load_calibration


def test_published_linear_angle():
    """A3: 0.1212 degrees a pixel, 0.875 degrees root mean square error."""
    rig = StereoRig()
    assert math.degrees(rig.pixel_angle) == pytest.approx(0.1212, abs=5e-5)
    p = rig.pixel_position(torch.arange(640, dtype=torch.float64))
    error = rig.angle(p, "linear") - rig.angle(p, "atan")
    assert math.degrees(float(error.square().mean().sqrt())) == pytest.approx(0.875, rel=0.01)


def test_field_of_view_and_signs():
    rig = StereoRig()
    angle = rig.angle(rig.pixel_position(torch.tensor([0.0, 319.5, 639.0], dtype=torch.float64)))
    assert math.degrees(float(angle[0] - angle[2])) == pytest.approx(73.3, abs=0.5)
    assert angle[0] > 0  # the left border looks left
    assert angle[1] == 0
    assert rig.row == 240


def test_subfields_of_the_default_floor():
    """Rows 86.0 to 57.3 below the middle, columns 30.1 to 115.2 outward of it."""
    left, right = StereoRig().subfields()
    assert left == Rect(297, 326, 205, 290)
    assert right == Rect(297, 326, 350, 435)
    assert left.left == 640 - right.right


def test_subfields_see_the_floor_asked_for():
    rig = StereoRig(pitch=0.1, camera_height=0.3, focal=500.0)
    left, _ = rig.subfields(0.9, 1.4, math.radians(3), math.radians(10))
    # The ray through the middle of the rectangle, intersected with the floor.
    column, row = (left.left + left.right - 1) / 2, (left.top + left.bottom - 1) / 2
    right_of, below = (column - 319.5) / 500, (row - 239.5) / 500
    forward = math.cos(0.1) - below * math.sin(0.1)
    down = math.sin(0.1) + below * math.cos(0.1)
    ahead = 0.3 / down * forward
    assert 0.9 < ahead < 1.4
    assert math.radians(3) < math.atan2(-right_of * 0.3 / down, ahead) < math.radians(10)


KITTI = (
    [[721.54, 0, 609.56, 44.857], [0, 721.54, 172.85, 0.216], [0, 0, 1, 0.0027]],
    [[721.54, 0, 609.56, -339.52], [0, 721.54, 172.85, 2.200], [0, 0, 1, 0.0027]],
)


def test_projection_matrices_of_kitti_and_opencv():
    rig = StereoRig.from_projections(*KITTI, 1242, 375, camera_height=1.65)
    assert rig.baseline == pytest.approx(0.5327, abs=1e-4)
    assert (rig.focal, rig.cx, rig.cy, rig.row, rig.camera_height) == (721.54, 609.56, 172.85, 173, 1.65)
    p = torch.tensor([[430.0, 0, 300, 0], [0, 430, 250, 0], [0, 0, 1, 0]], dtype=torch.float64)
    q = p.clone()
    q[0, 3] = -430 * 0.3
    made = StereoRig.from_projections(p, q.numpy(), 640, 480)
    assert made.baseline == pytest.approx(0.3)
    assert made.center == (300, 250)
    other = q.clone()
    other[0, 2] = 310
    for left, right in ((q, p), (p, other), (p[:2], q), (p * float("nan"), q)):
        with pytest.raises(InputError):
            StereoRig.from_projections(left, right, 640, 480)
    with pytest.raises(InputError, match="inside the frame"):
        StereoRig(cx=700.0)


def test_rigs_of_others() -> None:
    """Axes between two pixels; and a rig that shows no floor near the car says what to change."""
    euroc = StereoRig(0.11, 436.24, 752, 480, camera_height=0.2, cx=364.44)
    ours, theirs = euroc.subfields()
    assert ours.right - ours.left == theirs.right - theirs.left
    assert abs((ours.left + theirs.right - 1) / 2 - euroc.center[0]) <= 1
    Navigator(euroc, 0.05, controller="published")
    kitti = StereoRig(0.537, 707.09, 1241, 376, camera_height=1.65, cx=601.89, cy=183.11)
    with pytest.raises(InputError, match=r"in view is 6\.08 m ahead: mount the cameras at most 0\.18 m high"):
        Navigator(kitti, 0.1)
    assert replace(kitti, camera_height=0.17).floor_hint(0.65) == ""
    StereoRanging(kitti, 0.1)


DATA = Path(__file__).parents[3] / "shared/data/stereo"
FOCAL, CX, CY, BASELINE, WIDTH, HEIGHT = 430.5, 320.25, 239.75, 0.12, 640, 480
K = [FOCAL, 0.0, CX, 0.0, FOCAL, CY, 0.0, 0.0, 1.0]


def projection(number: int, unit: float = 1.0) -> list[float]:
    return [FOCAL, 0, CX, -number * FOCAL * BASELINE / unit, 0, FOCAL, CY, 0, 0, 0, 1, 0]


def ros(number: int, unit: float = 1.0) -> str:
    matrices = {
        "camera_matrix": K,
        "distortion_coefficients": [0.0] * 5,
        "rectification_matrix": list(np.eye(3).ravel()),
    }
    matrices["projection_matrix"] = projection(number, unit)
    lines = [f"{name}:\n  rows: 1\n  cols: {len(v)}\n  data: {[float(x) for x in v]}" for name, v in matrices.items()]
    head = [f"image_width: {WIDTH}", f"image_height: {HEIGHT}", "camera_name: stereo/left"]
    return "\n".join([*head, "distortion_model: plumb_bob", *lines])


def camera_info(number: int) -> str:
    values = f"K: {K}\nD: []\nR: {np.eye(3).ravel().tolist()}\nP: {projection(number)}"
    return f"height: {HEIGHT}\nwidth: {WIDTH}\ndistortion_model: plumb_bob\n{values}\n---\n"


def euroc(number: int) -> str:
    # The frame of the body is that of the left camera.
    pose = np.eye(4)
    pose[0, 3] = number * BASELINE
    return (
        f"%YAML:1.0\nT_BS:\n  cols: 4\n  rows: 4\n  data: {pose.ravel().tolist()}\nresolution: [{WIDTH}, {HEIGHT}]\n"
        f"camera_model: pinhole\nintrinsics: [{FOCAL}, {FOCAL}, {CX}, {CY}] #fu, fv\n"
        "distortion_model: radial-tangential\ndistortion_coefficients: [0.0, 0.0, 0.0, 0.0]\n"
    )


def kalibr() -> str:
    camera = (
        f"  camera_model: pinhole\n  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]\n  distortion_model: radtan\n"
        f"  intrinsics: [{FOCAL}, {FOCAL}, {CX}, {CY}]\n  resolution: [{WIDTH}, {HEIGHT}]\n  rostopic: /cam/image_raw\n"
    )
    rows = "".join(f"  - {row}\n" for row in np.eye(4).tolist()).replace(
        "[1.0, 0.0, 0.0, 0.0]", f"[1.0, 0.0, 0.0, {-BASELINE}]"
    )
    return f"cam0:\n{camera}cam1:\n  T_cn_cnm1:\n{rows}{camera}"


INTRINSICS = {f"M{n}": np.array(K).reshape(3, 3) for n in (1, 2)} | {f"D{n}": np.zeros((1, 5)) for n in (1, 2)}
EXTRINSICS = {"R": np.eye(3), "T": np.array([[-BASELINE], [0], [0]])}


def opencv(path: Path, values: dict[str, object]) -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        storage.write(name, value)
    storage.release()
    return path


@pytest.fixture(params=["ros", "camera_info", "euroc", "kalibr", "kitti", "yml", "json", "two"])
def files(request: pytest.FixtureRequest, tmp_path: Path) -> list[Path]:
    if request.param == "two":  # as OpenCV's sample stereo_calib writes them
        projections = {f"P{n}": np.array(projection(n - 1)).reshape(3, 4) for n in (1, 2)}
        made = EXTRINSICS | {"R1": np.eye(3), "R2": np.eye(3)} | projections
        return [opencv(tmp_path / "extrinsics.yml", made), opencv(tmp_path / "intrinsics.yml", INTRINSICS)]
    if request.param in ("yml", "json"):
        return [opencv(tmp_path / f"stereo.{request.param}", INTRINSICS | EXTRINSICS)]
    pairs = {"ros": ros, "camera_info": camera_info, "euroc": euroc}
    kitti = "".join(f"P{n}: {', '.join(map(str, projection(n)))}  # px\n" for n in (0, 1)) + "Tr: 1 0 0\n"
    texts = {"kalibr": kalibr(), "kitti": kitti}
    made = [pairs[request.param](n) for n in (0, 1)] if request.param in pairs else [texts[request.param]]
    paths = [tmp_path / f"{n}.yaml" for n in range(len(made))]
    for path, text in zip(paths, made, strict=True):
        path.write_text(text)
    return paths


def test_every_format_gives_the_same_rig(files: list[Path]) -> None:
    rig = StereoRig.load(*files, width=WIDTH, height=HEIGHT, camera_height=0.3)
    assert (rig.width, rig.height, rig.camera_height) == (WIDTH, HEIGHT, 0.3)
    assert rig.baseline == pytest.approx(BASELINE, rel=1e-4)
    assert (rig.focal, rig.cx, rig.cy) == pytest.approx((FOCAL, CX, CY), abs=1.0)


def test_what_cannot_be_a_calibration_is_refused(tmp_path: Path) -> None:
    """One camera, a missing part, numbers that cannot be, and files that would not end."""
    size, path = {"width": WIDTH, "height": HEIGHT}, tmp_path / "c.yml"
    for values, message in (
        (EXTRINSICS, "M1 .* is missing"),
        (INTRINSICS, "R is missing"),
        (INTRINSICS | EXTRINSICS | {"M2": np.zeros((3, 3))}, "finite|focal"),
    ):
        with pytest.raises(InputError, match=message):
            StereoRig.load(opencv(path, values), **size)
    aliases = "a: &a []\n" + "".join(f"{b}: &{b} [{f'*{a},' * 9}]\n" for a, b in zip("abcdefg", "bcdefgh", strict=True))
    for text, message in (
        (euroc(0), "both cameras"),
        (camera_info(0), "both cameras"),
        ("[" * 49_000, "lists"),
        ("[" * 100_000, "bytes"),
        (f"{aliases}M1: *h", "references"),
        (f"P0: {'nan ' * 12}\nP1: {'nan ' * 12}", "finite"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            StereoRig.load(path)
    os.mkfifo(tmp_path / "fifo")
    for name in ("/dev/zero", tmp_path / "fifo"):
        with pytest.raises(InputError, match="no regular file"):
            StereoRig.load(name)


def test_fisheye_lenses_are_rectified(tmp_path: Path) -> None:
    """A point of the scene lies where the rectified camera of the calibration has it."""
    k, d = np.array(K).reshape(3, 3), np.array([0.1, 0.02, -0.01, 0.003])
    text = kalibr().replace("radtan", "equidistant").replace("[0.0, 0.0, 0.0, 0.0]", str(d.tolist()))
    (tmp_path / "camchain.yaml").write_text(text)
    pair, point, raws = load_calibration(tmp_path / "camchain.yaml"), np.array([0.4, -0.3, 1.0]), []
    for number in (0, 1):
        seen = (point - (number * BASELINE, 0, 0)).reshape(1, 1, 3)
        x, y = cv2.fisheye.projectPoints(seen, np.zeros(3), np.zeros(3), k, d)[0].ravel().round().astype(int)
        raws.append(cv2.circle(np.zeros((HEIGHT, WIDTH), np.uint8), (int(x), int(y)), 3, 255, -1))
    for camera, image in zip((pair.left, pair.right), pair.rectify(*raws), strict=True):
        row, column = np.argwhere(image > 100).mean(0)
        assert (column, row) == pytest.approx((camera.projection @ [*point, 1])[:2], abs=1.5)


@pytest.mark.skipif(not DATA.is_dir(), reason="needs ../shared/data/stereo")
def test_real_files() -> None:
    with pytest.raises(InputError, match="give width and height"):
        StereoRig.load(DATA / "kitti/calib.txt")
    rig = StereoRig.load(DATA / "kitti/calib.txt", width=1241, height=376)
    assert (rig.baseline, rig.focal) == pytest.approx((0.537, 718.856), abs=1e-3)
    paths = [DATA / f"euroc/cam{n}/sensor.yaml" for n in (0, 1)]
    assert StereoRig.load(*paths).baseline == pytest.approx(0.11, abs=1e-3)
    pair = load_calibration(*paths)
    assert not pair.is_rectified
    names = sorted(path.name for path in (DATA / "euroc/cam0/data").iterdir())[:1]
    raw = [cv2.imread(str(DATA / f"euroc/cam{n}/data/{names[0]}"), 0) for n in (0, 1)]

    def rows_between(left: np.ndarray, right: np.ndarray) -> float:
        """Rows from places of the right image to those of the left one that look alike, in the median."""
        orb = cv2.ORB_create(1000)
        (a, da), (b, db) = (orb.detectAndCompute(image, None) for image in (left, right))
        found = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(da, db)
        good = sorted(found, key=lambda m: m.distance)[:100]
        return float(np.median([a[m.queryIdx].pt[1] - b[m.trainIdx].pt[1] for m in good]))

    assert abs(rows_between(*raw)) > 5
    assert abs(rows_between(*pair.rectify(*raw))) < 1


MIDDLEBURY = """cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]
cam1=[3997.684 0 1307.839; 0 3997.684 1011.728; 0 0 1]
doffs=131.111
baseline=193.001
width=2964
height=1988
"""


def test_calibrations_of_middlebury(tmp_path):
    """Z = baseline f / (d + doffs): the right image is moved by the offset, and the baseline is in mm."""
    (tmp_path / "calib.txt").write_text(MIDDLEBURY)
    rig, pair = StereoRig.load(tmp_path / "calib.txt"), load_calibration(tmp_path / "calib.txt")
    values = rig.focal, rig.baseline, rig.width, rig.height, *rig.center
    assert values == pytest.approx((3997.684, 0.193001, 2964, 1988, 1176.728, 1011.728))
    assert pair.maps[1][0][0, 500] - pair.maps[0][0][0, 500] == pytest.approx(131.111, abs=1e-3)


def test_calibrations_of_opencv_as_xml(tmp_path):
    """Read as `cv2.FileStorage` writes them; entities are not expanded."""
    file, eye = cv2.FileStorage(str(tmp_path / "rig.xml"), cv2.FILE_STORAGE_WRITE), np.eye(3)
    k, none = np.array([[430.0, 0, 320], [0, 430, 240], [0, 0, 1]]), np.zeros((1, 5))
    values = {"M1": k, "D1": none, "M2": k, "D2": none, "R": eye, "T": np.array([[-0.3], [0], [0]])}
    for name, value in ({"image_width": 640, "image_height": 480} | values).items():
        file.write(name, value)
    file.release()
    rig = StereoRig.load(tmp_path / "rig.xml")
    assert (rig.focal, rig.baseline, *rig.center) == pytest.approx((430, 0.3, 320, 240))
    laughs = "".join(f'<!ENTITY a{n + 1} "{f"&a{n};" * 10}">' for n in range(9))
    inside = '<opencv_storage><M1 type_id="opencv-matrix"><data>&a9;</data></M1></opencv_storage>'
    (tmp_path / "rig.xml").write_text(f'<!DOCTYPE l [<!ENTITY a0 "1 ">{laughs}]>{inside}')
    with pytest.raises(InputError, match="no calibration that is known"):
        StereoRig.load(tmp_path / "rig.xml")
