"""Calibration against cameras that are known exactly, and rectified strips of a misaligned pair."""

import json

import cv2
import numpy as np
import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig
from ndtorch.navigation.stereo.calibration_files import load_calibration, stereo_calibration
from ndtorch_robot.calibration import Rectifier, calibrate, find_corners, find_view, rectified_points, write_calibration
from ndtorch_robot.cameras.pair import CameraFrame, FramePair, open_cameras, to_tensor
from ndtorch_robot.cameras.source import CameraSettings
from ndtorch_robot.ports import Closing
from ndtorch_robot.sim.simulation import RIG
from tests.robot.support.calibration_board import BOARD, LEFT, RIGHT, board_pictures, draw_board, measured, rays, views
from tests.robot.support.fake_captures import LiveCapture, picture


def pair_of(turn=((1, 0, 0), (0, 1, 0), (0, 0, 1)), shift=(-0.3, 0.0, 0.0)):
    matrix = np.array([[430.0, 0, 319.5], [0, 430.0, 239.5], [0, 0, 1]])
    return stereo_calibration([matrix] * 2, [np.zeros(5)] * 2, np.array(turn, float), np.array(shift), (640, 480))


def test_corners_are_where_the_equations_of_the_camera_put_them():
    for left, _, corners in board_pictures(count=4, seed=2):
        points = find_corners(left, BOARD)
        true = LEFT.project(corners)
        if points is not None:
            assert min(np.abs(order - true).max() for order in (points, points[::-1])) < 0.2


def test_known_cameras_are_measured():
    calibration, quality = measured()
    assert quality.faults() == []
    assert quality.views >= 10
    right = calibration.right.projection
    assert -right[0, 3] / right[0, 0] == pytest.approx(np.linalg.norm(RIGHT.place), abs=4e-4)
    for camera, eye in ((calibration.left, LEFT), (calibration.right, RIGHT)):
        k = camera.matrix
        assert (k[0, 0], k[1, 1]) == pytest.approx((eye.fx, eye.fy), rel=2e-3)
        assert (k[0, 2], k[1, 2]) == pytest.approx((eye.cx, eye.cy), abs=1.5)
        assert camera.distortion[:2] == pytest.approx(eye.k[:2], abs=0.012)
    turn = calibration.right.rotation.T @ calibration.left.rotation
    assert np.degrees(np.linalg.norm(cv2.Rodrigues(turn @ RIGHT.rotation)[0])) < 0.2


def test_rectified_rows_and_ranges_of_points_that_were_not_calibrated_with():
    calibration, _ = measured()
    rng = np.random.default_rng(5)
    points = np.column_stack((rng.uniform(-0.6, 0.9, 2000), rng.uniform(-0.3, 0.3, 2000), rng.uniform(0.8, 2.2, 2000)))
    left = rectified_points(LEFT.project(points), calibration.left)
    right = rectified_points(RIGHT.project(points), calibration.right)
    inside = ((left > 0) & (left < 639) & (right > 0) & (right < 639)).all(1)
    across, rows = (left - right)[inside].T
    assert np.sqrt((rows**2).mean()) < 0.1
    depth = -calibration.right.projection[0, 3] / across
    error = np.abs(depth / (points @ calibration.left.rotation.T)[inside, 2] - 1)
    assert np.median(error) < 0.002
    assert error.max() < 0.006
    assert np.abs((LEFT.project(points) - RIGHT.project(points))[inside, 1]).mean() > 5


def test_strips_are_those_of_the_whole_rectified_image():
    calibration, _ = measured()
    rectifier = Rectifier(calibration, RIG)
    focal, row = rectifier.rig.focal, RIG.row
    matrix = np.array([[focal, 0, 319.5], [0, focal, 239.5], [0, 0, 1]])
    images = [np.random.default_rng(n).integers(0, 255, (480, 640, 3), dtype=np.uint8) for n in (0, 1)]
    for strips, image, camera, field in zip(
        rectifier.strips(*images), images, (calibration.left, calibration.right), rectifier.rig.subfields(), strict=True
    ):
        maps = cv2.initUndistortRectifyMap(
            camera.matrix, camera.distortion, camera.rotation, matrix, (640, 480), cv2.CV_32FC1
        )
        whole = to_tensor(cv2.remap(image, *maps, cv2.INTER_CUBIC))
        field_part = whole[..., field.top : field.bottom, field.left : field.right]
        for part, strip in ((whole[..., row : row + 1, :], strips.row), (field_part, strips.field)):
            # Positions are rounded to 1/32 of a pixel: seldom another way in a strip than in the image.
            assert strip.shape == part.shape
            assert (strip.int() - part.int()).abs().float().mean() < 0.1


def test_aligned_cameras_are_left_as_they_are():
    rectifier = Rectifier(pair_of(), RIG)
    image = np.random.default_rng(0).integers(0, 255, (480, 640, 3), dtype=np.uint8)
    left, right = rectifier.strips(image, image)
    whole, (field, other) = to_tensor(image), RIG.subfields()
    assert torch.equal(left.row, whole[..., 240:241, :])
    assert torch.equal(left.field, whole[..., field.top : field.bottom, field.left : field.right])
    assert torch.equal(right.field, whole[..., other.top : other.bottom, other.left : other.right])


def test_cameras_of_another_size_or_direction_are_refused():
    with pytest.raises(InputError, match="cannot be used for 320x240"):
        Rectifier(pair_of(), StereoRig(width=320, height=240, focal=215.0))
    with pytest.raises(InputError, match="turn the cameras until they look the same way"):
        Rectifier(pair_of(cv2.Rodrigues(np.array([0.0, 0.5, 0.0]))[0]), RIG)


def test_cameras_of_a_configuration_are_rectified(tmp_path):
    path = tmp_path / "pair.yaml"
    write_calibration(*measured(), path)
    settings = CameraSettings(left="0", right="1", max_age_ms=5000, calibration=path)
    cameras, rig = open_cameras(settings, RIG, opener=lambda *_: LiveCapture(30, size=(640, 480)))
    with cameras:
        frames = cameras.read()
    rectifier, image = Rectifier(load_calibration(path), RIG), picture(1, 640, 480)
    assert rig == rectifier.rig != RIG
    assert torch.equal(frames.left.row, rectifier.strips(image, image)[0].row)


def test_a_written_calibration_is_read_again(tmp_path):
    calibration, quality = measured()
    write_calibration(calibration, quality, tmp_path / "deep" / "pair.yaml")
    again = load_calibration(tmp_path / "deep" / "pair.yaml")
    assert again.size == (640, 480)
    for old, new in ((calibration.left, again.left), (calibration.right, again.right)):
        for part, other in zip(old, new, strict=True):
            np.testing.assert_allclose(part, other, atol=1e-6)


def test_views_that_give_no_calibration_are_refused():
    good = views()
    with pytest.raises(InputError, match="10 pairs that show the whole board are needed, got 4"):
        calibrate(good[:4], BOARD, (640, 480))
    with pytest.raises(InputError, match="left and right are swapped"):
        calibrate([view._replace(left=view.right, right=view.left) for view in good], BOARD, (640, 480))
    rng = np.random.default_rng(0)
    noisy = [view._replace(left=(view.left + rng.normal(0, 1, view.left.shape)).astype(np.float32)) for view in good]
    words = " ".join(calibrate(noisy, BOARD, (640, 480))[1].faults())
    assert "the left camera's model misses its corners" in words
    assert "right camera's" not in words
    flat = []
    for n in range(12):
        place = np.array([-0.05 + 0.003 * (n % 4), -0.1 + 0.003 * (n // 4), 0.9])
        pair = [draw_board(e, r, np.eye(3), place, 9, 6, 0.04) for e, r in zip((LEFT, RIGHT), rays(), strict=True)]
        flat.append(find_view(*pair, BOARD))
    with pytest.raises(InputError, match="tilt them by 30 degrees"):
        calibrate(flat, BOARD, (640, 480))
    assert 30 < measured()[1].tilt_deg < 110
    faults = measured()[1]._replace(covered_percent=30.0, tilt_deg=20.0).faults()
    assert len(faults) == 2


class Boards(Closing):
    """A board that is moved about before two cameras."""

    def __init__(self, settings):
        self.pairs = iter((*board_pictures(seed=0), *board_pictures(seed=1)))

    def read_pair(self):
        left, right, _ = next(self.pairs)
        return FramePair(CameraFrame(left, 0.0), CameraFrame(right, 0.0))


@pytest.mark.slow
def test_live_cameras_and_the_images_that_were_kept_of_them(tmp_path, capsys, monkeypatch):
    out, kept = tmp_path / "pair.yaml", tmp_path / "kept"
    monkeypatch.setattr("ndtorch_robot.cameras.pair.StereoCameras", Boards)
    command = ["calibrate", "x://left", "x://right", "--views", "11", "--keep", str(kept), "--out", str(out)]
    assert main(command) == 0
    assert f"written to {out}" in capsys.readouterr().out
    assert StereoRig.load(out).baseline == pytest.approx(0.301, abs=0.002)
    folders = [str(kept / side) for side in ("left", "right")]
    assert main(["calibrate", *folders, "--out", str(out), "--square-mm", "20", "--force", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["accepted"]
    assert result["baseline_m"] == pytest.approx(0.15, abs=0.001)  # a wrong square scales the pair
    for path in (kept / "right").iterdir():
        if int(path.stem) % 2:
            cv2.imwrite(str(path), np.roll(cv2.imread(str(path)), 9, 0))
    out.unlink()
    assert main(["calibrate", *folders, "--out", str(out)]) == 1
    assert "REFUSED" in capsys.readouterr().out
    assert not out.exists()
