"""What the command line says about input that it cannot use: one line, and code 2."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.command_line import refused


def test_one_picture_cannot_show_motion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    cv2.imwrite(str(folder / "1.png"), np.full((40, 60, 3), 90, dtype=np.uint8))
    for model in ("foreground", "published"):
        refused(
            ["bind", str(folder), "--model", model, "--json", "--out", str(tmp_path / "out")], capsys, "motion", "two"
        )
    assert not (tmp_path / "out" / "frames").exists()


def test_a_folder_with_pictures_of_two_sizes_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for name, size in (("1.png", (40, 60, 3)), ("2.png", (40, 64, 3))):
        cv2.imwrite(str(folder / name), np.full(size, 90, dtype=np.uint8))
    words = ("1.png is 60 x 40", "2.png 64 x 40")
    refused(["bind", str(folder), "--json", "--out", str(tmp_path / "out")], capsys, *words)
    assert not (tmp_path / "out").exists()


def test_a_source_that_was_probably_meant(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(["bind", "two-bar", "--out", str(tmp_path)], capsys, "did you mean two-bars?")
    mistyped = str(clip.with_name("bras.avi"))
    refused(["bind", mistyped, "--out", str(tmp_path)], capsys, mistyped, f"did you mean {clip}?")
    assert list(tmp_path.iterdir()) == []


def test_unknown_scene_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    refused(["bind", "four-bars", "--out", str(out)], capsys, "four-bars", "two-bars")
    refused(["render", "four-bars", str(tmp_path / "x.mp4")], capsys, "four-bars", "two-bars")
    # Nothing half-written.
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{clip}", "--gamma", "1"], ["--gamma is an option of published, scale-free; the model is foreground"]),
        (["{clip}", "--rule", "hebbian"], ["--rule is an option of published; the model is foreground"]),
        (["{clip}", "--fit", "stretch"], ["--fit", "published", "the model is foreground"]),
        (["two-bars", "--model", "scale-free", "--order", "printed"], ["--order is an option of published"]),
        (["{clip}", "--model", "video"], ["the model video is gone; foreground does its job"]),
        (["two-bars", "--model", "cubist"], ["model", "published", "foreground", "cubist"]),
        (["two-bars", "--rule", "scale-free"], ["--model scale-free"]),
        (["{clip}", "--front-end", "on"], ["--model foreground"]),
        (["{clip}", "--front-end", "off"], ["--model published"]),
    ],
)
def test_what_a_model_does_not_know_is_refused(
    arguments: list[str], words: list[str], clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [argument.format(clip=clip) for argument in arguments]
    refused(["bind", *given, "--out", str(tmp_path / "out")], capsys, *words)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--rule", "oja"], ["rule", "competitive"]),
        (["--order", "last"], ["order", "filter-first"]),
        (["--gamma", "-1"], ["gamma", "-1"]),
        (["--gamma", "nan"], ["gamma", "nan"]),
        (["--seconds", "0"], ["seconds", "0"]),
        (["--seconds", "nan"], ["seconds", "nan"]),
        (["--fps", "-5"], ["fps", "-5"]),
        (["--phase", "inf"], ["phase"]),
        (["--first-stage-radius", "1.5"], ["radius", "1.5"]),
        (["--device", "abacus"], ["device", "abacus"]),
        (["--start", "3"], ["start"]),
        (["--pictures", "-1"], ["pictures", "-1"]),
        (["--resume", "nowhere"], ["nowhere", "missing"]),
    ],
)
def test_unusable_option_is_refused(
    options: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(["bind", *options, "--out", str(tmp_path / "out")], capsys, *words)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["missing", "empty", "text", "cut"])
def test_unusable_video_is_refused(kind: str, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"{kind}.avi"
    if kind != "missing":
        path.write_bytes({"empty": b"", "text": b"not a video " * 999, "cut": clip.read_bytes()[:200]}[kind])
    refused(["bind", str(path), "--out", str(tmp_path / "out")], capsys, str(path))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("source", ["camera:97", "/dev/video97"])
def test_camera_that_is_not_there_is_refused(source: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(["bind", source, "--out", str(tmp_path / "out")], capsys)
    assert not (tmp_path / "out").exists()


def test_scene_options_are_refused_for_video(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(["bind", str(clip), "--phase", "60", "--out", str(tmp_path / "out")], capsys, "phase")
    refused(["bind", str(clip), "--start", "90", "--out", str(tmp_path / "out")], capsys, "start")
    assert list(tmp_path.iterdir()) == []


def test_output_that_cannot_be_written_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    refused(["bind", "--seconds", "0.1", "--out", str(blocked)], capsys, "--out", str(blocked))
    assert blocked.read_text() == "in the way"
