"""`ndtorch calibrate` from folders, films and live cameras."""

import json

import cv2
import numpy as np
import pytest

from ndtorch.cli.commands import main
from ndtorch_robot.calibration import read_calibration
from tests.robot.support.fake_captures import folder_of
from tests.robot.support.misaligned import board_pictures, measured


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
