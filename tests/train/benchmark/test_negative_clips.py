"""Clips without any object: drawn alike every time, and nothing that is reported there is right."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch_train.benchmark.foreground import measure, negative_clip
from ndtorch_train.benchmark.mot import Pixels
from ndtorch_train.benchmark.negative_clips import FPS, KINDS, still_image


@pytest.fixture
def still() -> Pixels:
    chance = np.random.default_rng(2)
    coarse = chance.integers(40, 200, (6, 8, 3), dtype=np.uint8)
    return np.asarray(cv2.resize(coarse, (128, 96), interpolation=cv2.INTER_CUBIC))


@pytest.mark.parametrize("kind", KINDS)
def test_a_clip_is_the_same_every_time_and_changes_with_time(still: Pixels, kind: str) -> None:
    labelled = negative_clip(kind, still, 1.0, "tune")
    frames, again = list(labelled.clip.frames), list(labelled.clip.frames)
    assert len(frames) == FPS
    assert all(frame.shape == (96, 128, 3) and frame.dtype == np.uint8 for frame in frames)
    assert all(np.array_equal(a, b) for a, b in zip(frames, again, strict=True))
    assert not np.array_equal(frames[3], frames[9])
    assert not np.array_equal(frames[3], next(iter(negative_clip(kind, still, 1.0, "test").clip.frames)))
    assert list(labelled.truth()) == []


def test_what_is_reported_there_is_false(still: Pixels, tmp_path: Path) -> None:
    (row,) = measure("foreground", "rain", lambda out: negative_clip("rain", still, 2.0, "tune"), 0, tmp_path)
    assert (row["recall"], row["idf1"], row["mask_f"]) == (0, None, None)
    assert row["false_per_minute"] >= 0


def test_a_still_image_is_an_image_or_the_median_of_a_video(still: Pixels, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "still.png"), still)
    assert np.array_equal(still_image(tmp_path / "still.png"), still)
    film = cv2.VideoWriter(str(tmp_path / "clip.mkv"), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (128, 96))
    for n in range(5):
        frame = still.copy()
        frame[10:20, 20 * n : 20 * n + 10] = 255
        film.write(frame)
    film.release()
    assert np.abs(still_image(tmp_path / "clip.mkv").astype(int) - still).max() <= 3
    (tmp_path / "text").write_text("words")
    for path, message in (
        (tmp_path / "none", "no such file"),
        (tmp_path / "text", "is not an image or video of 32 x 32"),
    ):
        with pytest.raises(InputError, match=message):
            still_image(path)
