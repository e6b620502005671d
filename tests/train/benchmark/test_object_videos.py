"""Masks and identities in short videos: the score by hand, and what the drawn videos promise."""

import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch_train.benchmark.object_videos import SETS, clear_mot, color_tracker, layers, object_video_benchmark


def bars(columns: list[tuple[int, ...]]) -> np.ndarray:
    """Labels `[T, 20, 40]` with a block of 10 x 5 pixels for each label at the columns of each frame; -1: none."""
    labels = np.zeros((len(columns), 20, 40), int)
    for t, frame in enumerate(columns):
        for label, column in enumerate(frame, start=1):
            if column >= 0:
                labels[t, 5:15, column : column + 5] = label
    return labels


TRUTH = [(0, 20)] * 6


@pytest.mark.parametrize(
    ("found", "misses", "false_positives", "switches", "motp"),
    [
        (TRUTH, 0, 0, 0, 1.0),
        ([(20, 0)] * 6, 0, 0, 0, 1.0),
        ([(0, 20)] * 4 + [(20, 0)] * 2, 0, 0, 2, 1.0),
        ([(0, -1)] * 6, 4, 0, 0, 1.0),
        ([(0, 20, 30)] * 6, 0, 4, 0, 1.0),
        # 4 of 5 columns shared: IoU 4/6
        ([(1, 20)] * 6, 0, 0, 0, (4 / 6 + 1) / 2),
        # 3 of 5: IoU 3/7 < .5, a miss and a false positive each
        ([(2, 20)] * 6, 4, 4, 0, 1.0),
        # The two frames of warming up do not count.
        ([(-1, -1)] * 2 + [(0, 20)] * 4, 0, 0, 0, 1.0),
    ],
)
def test_score_of_what_was_found(found, misses, false_positives, switches, motp):
    score = clear_mot(bars(TRUTH), bars(found))
    assert score[:5] == (8, 8 - misses, misses, false_positives, switches)
    assert score.mota == 1 - (misses + false_positives + switches) / 8
    assert score.motp == pytest.approx(motp)


def test_small_masks_and_the_ground_do_not_count():
    found = bars(TRUTH)
    found[:, 0, 39] = 7
    found[found == 0] = 9
    assert clear_mot(bars(TRUTH), found)[:5] == (8, 8, 0, 0, 0)


@pytest.mark.parametrize("name", list(SETS))
def test_videos_are_what_they_promise(name):
    frames, masks = SETS[name](np.random.default_rng(3))
    assert frames.shape == (10, 64, 64, 3)
    assert frames.dtype == masks.dtype == np.uint8
    assert masks.shape == (10, 64, 64)
    assert masks.max() <= 4
    still = (masks[1:] == 0) & (masks[:-1] == 0)
    assert (frames[1:] == frames[:-1])[still].all(), "the ground does not move"
    same = SETS[name](np.random.default_rng(3))
    assert np.array_equal(frames, same[0])
    assert np.array_equal(masks, same[1])


def test_both_methods_follow_plain_objects():
    videos = [SETS["vmds"](np.random.default_rng(n)) for n in range(3)]
    for method in (layers, color_tracker):
        assert min(clear_mot(masks, method(frames)).mota for frames, masks in videos) > 0.9, method


def test_what_is_refused(tmp_path):
    for folder, methods, sets, count, words in (
        (None, ["x"], ["vmds"], 1, "x"),
        (None, ["layers"], ["y"], 1, "y"),
        (None, ["layers"], ["vmds"], 0, "videos must be"),
        (tmp_path / "none", ["layers"], ["vmds"], 1, "is not a folder"),
    ):
        with pytest.raises(InputError, match=words):
            object_video_benchmark(folder, methods, sets, count, "tune")


def test_videos_of_a_folder(tmp_path):
    frames, masks = SETS["vmds"](np.random.default_rng(0))
    np.savez(tmp_path / "vmds.npz", frames=frames[None], masks=masks[None])
    (task,) = object_video_benchmark(tmp_path, ["colors"], ["vmds"], 30, "tune").tasks
    (row,) = task.work(tmp_path)
    assert row["case"] == "vmds"
    assert row["objects"] == clear_mot(masks, masks).objects
    np.savez(tmp_path / "vmds.npz", frames=frames)
    with pytest.raises(InputError, match="needs frames"):
        task.work(tmp_path)
