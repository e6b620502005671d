"""Generated video: the clips are what their truth says, and the score tells right from wrong."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ndtorch.commands import main
from ndtorch_train.score.video_clips import DIRECTIONS, SPLIT_SEEDS, draw_clip, truth
from ndtorch_train.score.video_encode import codec
from ndtorch_train.score.video_paint import Painter
from ndtorch_train.score.video_score import ClipScore, clip_file, score_clip, table

# The first one-object clip of the tune split at 12.5 a second whose frames are the smallest.
ONE = next(clip for n in range(50) if (clip := draw_clip("tune", n, 1, 12.5)).size == (180, 320))


def test_clips_repeat_and_splits_and_cells_differ() -> None:
    assert draw_clip("tune", 3, 2, 25.0) == draw_clip("tune", 3, 2, 25.0)
    clips = [draw_clip(split, n, c, f) for split in SPLIT_SEEDS for n in (0, 1) for c in (1, 2) for f in (12.5, 25.0)]
    assert len({clip.movers for clip in clips}) == len(clips)
    frames = [next(Painter(ONE).frames()) for _ in range(2)]
    assert np.array_equal(*frames)


@pytest.mark.parametrize("number", range(6))
def test_objects_move_as_the_truth_says(number: int) -> None:
    clip = draw_clip("tune", number, 2, 25.0)
    for thing in truth(clip)["objects"]:
        first, last = np.array(thing["places"][0]), np.array(thing["places"][-1])
        down, right = (last - first) * [1, clip.size[1] / clip.size[0]]
        axis = {"left": -right, "right": right, "down": down, "up": -down}
        assert thing["direction"] == max(DIRECTIONS, key=lambda d: axis[d])
        assert len(thing["times"]) >= 12


def test_the_object_is_drawn_where_the_truth_says() -> None:
    known = truth(ONE)["objects"][0]
    empty = list(Painter(replace(ONE, movers=())).frames())
    for n, frame in enumerate(Painter(ONE).frames()):
        time = round(n / ONE.fps, 2)
        if time not in known["times"] or n % 10:
            continue
        row, column = known["places"][known["times"].index(time)]
        changed = np.abs(frame.astype(int) - empty[n]).max(-1) > 40
        rows, columns = np.nonzero(changed)
        assert rows.mean() / 180 == pytest.approx(row, abs=0.12)
        assert columns.mean() / 320 == pytest.approx(column, abs=0.08)


def test_clips_without_objects_change_in_light_only() -> None:
    clip = draw_clip("tune", 0, 0, 12.5)
    assert clip.movers == ()
    assert clip.steps
    assert clip.flicker
    assert truth(clip)["count_over_time"] == [0] * 80


@pytest.mark.slow
def test_score_tells_right_from_wrong(tmp_path: Path) -> None:
    path, used = clip_file(ONE, tmp_path)
    assert used == codec()
    score = score_clip(ONE, path)
    assert score.right
    assert score.away < 0.2
    mover = ONE.movers[0]
    other = {"left": "right", "right": "left", "up": "down", "down": "up"}[mover.direction]
    assert not score_clip(replace(ONE, movers=(replace(mover, direction=other),)), path).right
    assert not score_clip(replace(ONE, movers=()), path).right


def test_table_counts_by_objects_and_rate() -> None:
    scores = [ClipScore("a", 1, 25.0, 1, right, right, 0.1, 0.2) for right in (True, True, True, False)]
    text = table([*scores, ClipScore("b", 0, 12.5, 0, True, True, 0.0, 0.2)])
    assert "| 1 | - | 0.75 ± 0.22 (4) | 0.75 ± 0.22 (4) | 1.00 ± 0.00 (4) | 0.75 ± 0.22 (4) | 0.10 |" in text
    assert "| 0 | 1.00 ± 0.00 (1) | - |" in text


def test_unusable_options_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for options, word in (
        (["--fps", "0"], "fps must lie"),
        (["--rates", "25"], "--rates is gone: it is called --fps now"),
        (["--counts", "9"], "counts"),
        (["--ablate", "sight"], "ablate"),
        (["--file", str(tmp_path / "no.mp4")], "no.mp4"),
        (["--clips", "-1"], "clips"),
    ):
        assert main(["score", "--video", *options, "--out", str(tmp_path / "out")]) == 2
        assert word in capsys.readouterr().err
