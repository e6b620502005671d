"""Calibration against cameras that are known exactly, and ranges through a misaligned pair."""

import json

import cv2
import numpy as np
import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig
from ndtorch_robot.calibration import (
    Calibration,
    Rectifier,
    calibrate,
    faults,
    find_corners,
    find_view,
    read_calibration,
    write_calibration,
)
from ndtorch_robot.calibration.solve import rectified
from ndtorch_robot.cameras import CameraSettings, StereoCameras, open_cameras
from ndtorch_robot.cameras.pair import to_tensor
from ndtorch_robot.sim.simulation import RIG
from tests.robot.support.calibration_board import BOARD, LEFT, RIGHT, board_pictures, draw_board, measured, rays, views
from tests.robot.support.fake_captures import folder_of


def test_renderer_agrees_with_its_own_projection():
    """A corner found in a picture is where the camera's equations put it."""
    found = []
    for left, _, corners in board_pictures(count=4, seed=2):
        points = find_corners(left, BOARD)
        if points is not None:
            true = LEFT.project(corners)
            found.append(min(np.abs(order - true).max() for order in (points, points[::-1])))
    assert len(found) >= 2
    assert max(found) < 0.2


def test_known_cameras_are_found():
    calibration = measured()
    assert faults(calibration.quality) == []
    assert calibration.quality.views >= 10
    assert calibration.baseline_m == pytest.approx(np.linalg.norm(RIGHT.place), abs=4e-4)
    for lens, eye in ((calibration.left, LEFT), (calibration.right, RIGHT)):
        assert (lens.fx_px, lens.fy_px) == pytest.approx((eye.fx, eye.fy), rel=2e-3)
        assert (lens.cx_px, lens.cy_px) == pytest.approx((eye.cx, eye.cy), abs=1.5)
        assert lens.distortion[:2] == pytest.approx(eye.k[:2], abs=0.012)
    angle = np.linalg.norm(cv2.Rodrigues(calibration.rotation @ RIGHT.rotation)[0])
    assert np.degrees(angle) < 0.2


def test_rectified_rows_and_ranges_of_points_never_seen():
    calibration = measured()
    turns, matrix = calibration.rectification(), calibration.camera_matrix()
    rng = np.random.default_rng(5)
    points = np.column_stack((rng.uniform(-0.6, 0.9, 2000), rng.uniform(-0.3, 0.3, 2000), rng.uniform(0.8, 2.2, 2000)))
    left = rectified(LEFT.project(points), calibration.left, turns[0], matrix)
    right = rectified(RIGHT.project(points), calibration.right, turns[1], matrix)
    both = ((left > 0) & (left < 639) & (right > 0) & (right < 639)).all(1)
    across, rows = (left - right)[both].T
    assert both.mean() > 0.8
    assert np.sqrt((rows**2).mean()) < 0.1
    depth = calibration.focal_px * calibration.baseline_m / across
    error = np.abs(depth / (points @ turns[0].T)[both, 2] - 1)
    assert np.median(error) < 0.002
    assert error.max() < 0.006
    raw_rows = (LEFT.project(points) - RIGHT.project(points))[both, 1]
    assert np.abs(raw_rows).mean() > 5  # what there was to correct, in pixels


def test_strips_are_those_of_the_whole_rectified_picture():
    calibration = measured()
    rectifier = Rectifier(calibration, RIG)
    assert rectifier.rig.baseline == calibration.baseline_m
    assert rectifier.rig.focal == calibration.focal_px
    images = [np.random.default_rng(n).integers(0, 255, (480, 640, 3), dtype=np.uint8) for n in (0, 1)]
    fields = rectifier.rig.subfields()
    lenses = (calibration.left, calibration.right)
    for strips, image, lens, rotation, field in zip(
        rectifier.strips(*images), images, lenses, calibration.rectification(), fields, strict=True
    ):
        maps = cv2.initUndistortRectifyMap(
            lens.matrix, lens.coefficients, rotation, calibration.camera_matrix(), (640, 480), cv2.CV_32FC1
        )
        whole = to_tensor(cv2.remap(image, *maps, cv2.INTER_CUBIC))
        row = RIG.row
        for part, mine in (
            (whole[..., row : row + 1, :], strips.row),
            (whole[..., field.top : field.bottom, field.left : field.right], strips.field),
        ):
            # Places are rounded to 1/32 of a pixel: seldom another way in a strip than in the picture.
            assert mine.shape == part.shape
            assert (mine.int() - part.int()).abs().float().mean() < 0.1


def test_aligned_cameras_are_left_alone():
    """A perfect pair: the strips are the pixels themselves."""
    lens = {"fx_px": 430.0, "fy_px": 430.0, "cx_px": 319.5, "cy_px": 239.5, "distortion": (0.0,) * 5}
    perfect = measured().model_dump() | {
        "left": lens,
        "right": lens,
        "rotation_rad": (0.0, 0.0, 0.0),
        "translation_m": (-0.3, 0.0, 0.0),
        "focal_px": 430.0,
    }
    rectifier = Rectifier(Calibration.model_validate(perfect), RIG)
    image = np.random.default_rng(0).integers(0, 255, (480, 640, 3), dtype=np.uint8)
    left, right = rectifier.strips(image, image)
    whole, (field, other) = to_tensor(image), RIG.subfields()
    assert torch.equal(left.row, whole[..., 240:241, :])
    assert torch.equal(left.field, whole[..., field.top : field.bottom, field.left : field.right])
    assert torch.equal(right.field, whole[..., other.top : other.bottom, other.left : other.right])


def test_another_resolution_is_refused(tmp_path):
    with pytest.raises(InputError, match="is for 640x480 frames and cannot be used for 320x240"):
        Rectifier(measured(), StereoRig(width=320, height=240, focal=215.0))
    folder = str(folder_of(tmp_path / "small", 1))
    settings = CameraSettings(left=folder, right=folder, width_px=64, height_px=48)
    with pytest.raises(InputError, match="cannot be used for 64x48"):
        StereoCameras(settings, rectify=Rectifier(measured(), RIG))


def test_cameras_of_a_configuration_are_corrected(tmp_path):
    path = tmp_path / "pair.toml"
    write_calibration(measured(), path)
    folder = folder_of(tmp_path / "film", 1, 640, 480)
    settings = CameraSettings(left=str(folder), right=str(folder), pace="read", calibration=path)
    cameras, rig = open_cameras(settings, RIG)
    with cameras:
        frames = cameras.read()
    assert rig == Rectifier(measured(), RIG).rig != RIG
    image = cv2.imread(str(folder / "0.png"))
    assert torch.equal(frames.left.row, Rectifier(measured(), RIG).strips(image, image)[0].row)
    with pytest.raises(InputError, match="must be opened by open_cameras"):
        StereoCameras(settings)
    raw_cameras, same = open_cameras(settings.model_copy(update={"calibration": None}), RIG)
    raw_cameras.close()
    assert same == RIG


def test_cameras_that_look_apart_are_refused():
    values = measured().model_dump() | {"rotation_rad": (0.0, 0.5, 0.0)}
    with pytest.raises(InputError, match="turn the cameras until they look the same way"):
        Rectifier(Calibration.model_validate(values), RIG)


def test_bad_views_are_refused():
    """Too few; swapped; a wrong square; boards that never tilt."""
    good = views()
    with pytest.raises(InputError, match="10 pairs that show the whole board are needed, got 4"):
        calibrate(good[:4], BOARD, (640, 480))
    with pytest.raises(InputError, match="left and right are swapped"):
        calibrate([view._replace(left=view.right, right=view.left) for view in good], BOARD, (640, 480))
    shaken = np.random.default_rng(0)
    noisy = [view._replace(left=(view.left + shaken.normal(0, 1, view.left.shape)).astype(np.float32)) for view in good]
    words = " ".join(faults(calibrate(noisy, BOARD, (640, 480)).quality))
    assert "the left camera's model misses its corners" in words
    assert "right camera's" not in words
    flat = []
    for n in range(12):
        place = np.array([-0.05 + 0.003 * (n % 4), -0.1 + 0.003 * (n // 4), 0.9])
        pair = [draw_board(e, r, np.eye(3), place, 9, 6, 0.04) for e, r in zip((LEFT, RIGHT), rays(), strict=True)]
        flat.append(find_view(*pair, BOARD))
    with pytest.raises(InputError, match=r"boards that all face the same way .* tilt the board by 30"):
        calibrate(flat, BOARD, (640, 480))
    assert 30 < measured().quality.tilt_deg < 110
    for change, message in (
        ({"covered_percent": 30.0}, "boards covered 30 %"),
        ({"tilt_deg": 9.0}, "within 9 degrees"),
    ):
        assert message in " ".join(faults(measured().quality.model_copy(update=change)))


def test_file_round_trip(tmp_path):
    path = tmp_path / "deep" / "pair.toml"
    write_calibration(measured(), path)
    assert read_calibration(path) == measured()
    text = path.read_text()
    assert "baseline" not in text.splitlines()[1]
    assert all(key in text for key in ("width_px", "translation_m", "rotation_rad", "fx_px", "[quality]", "row_px"))
    with pytest.raises(InputError, match="cannot write the calibration"):
        write_calibration(measured(), tmp_path / "deep" / "pair.toml" / "x.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fx_px = 4", "fx_px = -4", "fx_px"),
        ("width_px = 640", "width_px = 640\nwidth = 3", "unknown key 'width'"),
        ('calibration 1"', 'calibration 9"', "format"),
    ],
)
def test_bad_files(tmp_path, old, new, message):
    path = tmp_path / "pair.toml"
    write_calibration(measured(), path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        read_calibration(path)


def write_pictures(folder):
    pairs = [pair[:2] for pair in board_pictures()]
    for k, side in enumerate(("left", "right")):
        (folder / side).mkdir(parents=True)
        for n, pair in enumerate(pairs):
            cv2.imwrite(str(folder / side / f"{n}.png"), pair[k])
    return str(folder / "left"), str(folder / "right")


def test_command_from_folders(tmp_path, capsys):
    left, right = write_pictures(tmp_path)
    out = tmp_path / "pair.toml"
    assert main(["calibrate", left, right, "--out", str(out), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["accepted"]
    assert read_calibration(out) == measured()
    # Squares of the wrong size cannot be noticed: the baseline follows them. It is shown for that reason.
    assert main(["calibrate", left, right, "--out", str(out), "--square-mm", "20", "--force"]) == 0
    text = capsys.readouterr().out
    assert "baseline 150." in text
    assert "written to" in text
    for path in (tmp_path / "right").iterdir():  # a shaken hand: every other picture from another moment
        if int(path.stem) % 2:
            cv2.imwrite(str(path), np.roll(cv2.imread(str(path)), 9, 0))
    out.unlink()
    assert main(["calibrate", left, right, "--out", str(out)]) == 1
    assert "REFUSED" in capsys.readouterr().out
    assert not out.exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: (f / "right" / "0.png").unlink(), "as many images, got 2 in"),
        (lambda f: [p.unlink() for p in (f / "left").iterdir()], "holds no images"),
        (lambda f: [p.unlink() for p in (f / "right").iterdir()] + [(f / "right").rmdir()], "no such folder"),
        (
            lambda f: cv2.imwrite(str(f / "left" / "1.png"), np.zeros((9, 9), np.uint8)),
            "all images must be of one size",
        ),
        (lambda f: None, "10 pairs that show the whole board are needed, got 0"),
    ],
)
def test_command_bad_input(tmp_path, capsys, change, message):
    for side in ("left", "right"):
        folder_of(tmp_path / side, 2)
    change(tmp_path)
    assert main(["calibrate", str(tmp_path / "left"), str(tmp_path / "right"), "--out", str(tmp_path / "o.toml")]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1


def write_films(folder, pictures, rate):
    """Videos that two cameras might give, as motion JPEG."""
    paths = []
    for k, side in enumerate(("left", "right")):
        path = folder / f"{side}.avi"
        film = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), rate, (640, 480))
        for pair in pictures:
            film.write(cv2.cvtColor(pair[k], cv2.COLOR_GRAY2BGR))
        film.release()
        paths.append(str(path))
    return paths


@pytest.mark.slow
@pytest.mark.realtime
def test_live_command_from_a_moving_board(tmp_path, capsys):
    """Videos that run on in real time as cameras: views are taken as the board moves, and the pair is found."""
    pictures = [pair[:2] for seed in (0, 1) for pair in board_pictures(seed=seed)]
    films = write_films(tmp_path, pictures, 6.0)
    out, kept = tmp_path / "pair.toml", tmp_path / "kept"
    assert main(["calibrate", *films, "--views", "13", "--keep", str(kept), "--out", str(out)]) == 0
    text = capsys.readouterr()
    assert f"written to {out}" in text.out
    count = text.err.count("  view ")
    assert 10 <= count <= 13
    assert [len(list((kept / side).iterdir())) for side in ("left", "right")] == [count, count]
    live, true = read_calibration(out), measured()
    assert live.baseline_m == pytest.approx(0.301, abs=0.002)
    assert live.rotation_rad == pytest.approx(true.rotation_rad, abs=0.004)
    assert live.quality.row_px < 0.3
    # From the pictures that were kept comes the very same.
    assert main(["calibrate", str(kept / "left"), str(kept / "right"), "--out", str(tmp_path / "again.toml")]) == 0
    assert (tmp_path / "again.toml").read_bytes() == out.read_bytes()


def test_live_command_without_a_board(tmp_path, capsys):
    """Nothing is written; what is missing is said."""
    films = write_films(tmp_path, [[np.full((480, 640), 120, np.uint8)] * 2] * 6, 30.0)
    assert main(["calibrate", *films, "--out", str(tmp_path / "pair.toml")]) == 2
    assert "10 pairs that show the whole board are needed, got 0" in capsys.readouterr().err
    assert not (tmp_path / "pair.toml").exists()
