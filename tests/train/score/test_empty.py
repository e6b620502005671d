"""Clips without anything: drawn alike every time, and scored like others."""

import csv

import cv2
import numpy as np
import pytest

from ndtorch.commands import main
from ndtorch_train.score.labelled import weather
from ndtorch_train.score.labelled.empty import KINDS, empty_clips
from ndtorch_train.score.labelled.weather import FPS


@pytest.fixture
def picture(tmp_path):
    chance = np.random.default_rng(2)
    coarse = chance.integers(40, 200, (6, 8, 3), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "still.png"), cv2.resize(coarse, (128, 96), interpolation=cv2.INTER_CUBIC))
    return tmp_path / "still.png"


@pytest.mark.parametrize("kind", KINDS)
def test_a_clip_is_the_same_every_time_and_changes_with_time(picture, kind):
    clips = {clip.clip.name: clip for clip in empty_clips(picture, 1.0, "tune")}
    frames, again = list(clips[kind].clip.frames), list(clips[kind].clip.frames)
    assert len(frames) == FPS
    assert all(frame.shape == (96, 128, 3) and frame.dtype == np.uint8 for frame in frames)
    assert all(np.array_equal(a, b) for a, b in zip(frames, again, strict=True))
    assert not np.array_equal(frames[3], frames[9])
    others = {clip.clip.name: clip for clip in empty_clips(picture, 1.0, "test")}
    assert not np.array_equal(frames[3], next(iter(others[kind].clip.frames)))
    assert list(clips[kind].truth()) == []


def test_what_is_reported_there_is_false(picture, tmp_path, monkeypatch):
    monkeypatch.setattr(weather, "SWAY", 40.0)  # a storm, which makes objects of leaves
    pytest.importorskip("norfair")
    words = ["score", "--empty", str(picture), "--empty-seconds", "2", "--methods", "mog2-norfair"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 0
    with (tmp_path / "out" / "labelled.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["clip"] for row in rows] == list(KINDS)
    by_kind = {row["clip"]: float(row["false_per_minute"]) for row in rows}
    assert by_kind["leaves"] > by_kind["noise"] >= 0  # what moves is a foreground to it


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--empty", "nothing.png"], "nothing.png: no such file"),
        (["--empty", "{picture}", "--empty-seconds", "0"], "empty-seconds must lie between 1 and 3600, got 0"),
        (["--empty", "{text}"], "is no picture or video of 32 x 32 pixels or more"),
    ],
)
def test_mistakes(picture, tmp_path, capsys, words, message):
    (tmp_path / "text").write_text("words")
    given = [word.format(picture=picture, text=tmp_path / "text") for word in words]
    assert main(["score", *given, "--out", str(tmp_path / "out")]) == 2
    assert message in capsys.readouterr().err
