"""Scores of patches of moving dots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch.scenes import CommonFate
from ndtorch_train.benchmark.common_fate import CONDITIONS, FIRST_SEED, METHODS, Found, fate_benchmark, scored
from ndtorch_train.benchmark.mot import mask_iou
from ndtorch_train.benchmark.object_videos import SETS, clear_mot, color_tracker, layers, object_video_benchmark
from ndtorch_train.benchmark.shape_identification import CONDITIONS as SHAPE_CONDITIONS
from ndtorch_train.benchmark.shape_identification import Condition, Film, shape_benchmark


def masks() -> np.ndarray:
    truth = np.zeros((2, 40, 60), dtype=bool)
    truth[0, 5:15, 5:15] = truth[1, 20:30, 40:50] = True
    return truth


def test_scores_tell_right_from_wrong() -> None:
    truth = masks()
    right = [Found((10.0, 10.0), truth[0]), Found((45.0, 25.0), truth[1])]
    assert scored(right, truth) == (True, 1.0, 1.0)
    # Half of one, nothing of the other, and one where nothing is.
    half = truth[0].copy()
    half[:, 10:] = False
    count, place, overlap = scored([Found((7.0, 10.0), half), Found((30.0, 3.0), None)], truth)
    assert (count, place, overlap) == (True, 0.5, 0.25)
    assert scored([], truth) == (False, 0.0, 0.0)
    assert scored([Found((1.0, 1.0), None)], truth[:0]) == (False, 0.0, None)


def test_splits_have_no_seed_in_common() -> None:
    assert FIRST_SEED["tune"] + 10_000 * sum(map(len, CONDITIONS.values())) < FIRST_SEED["test"]


@pytest.mark.parametrize("method", METHODS)
def test_every_method_says_what_is_there_at_every_moment(method: str) -> None:
    scene = CommonFate(0.6, seed=3, size=(64, 80))
    found = METHODS[method]()(scene, [4, 14])
    assert len(found) == 2
    for obj in (obj for now in found for obj in now):
        assert len(obj.place) == 2
        assert obj.mask is None or obj.mask.shape == scene.size


def test_the_table_has_a_row_for_every_condition_and_method(tmp_path: Path) -> None:
    made = fate_benchmark(["mog2"], ["ground"], 1, "tune")
    assert [task.key for task in made.tasks] == ["ground 0.5, mog2", "ground 1, mog2"]
    rows, text, folder, failed = made.run(tmp_path / "out", 1, False, False, print)
    assert [(row["condition"], row["value"], row["method"]) for row in rows] == [
        ("ground", 0.5, "mog2"),
        ("ground", 1, "mog2"),
    ]
    assert not failed
    assert "| ground 0.5 |" in text
    assert (folder / "common-fate.png").stat().st_size > 10_000


def test_single_frames_do_not_show_the_shape() -> None:
    film = Film(1, Condition(density=(512, 512), fastest=0.0))
    inside = film.mask(0, 0)
    white = film.frames == 255
    # Dots of one density everywhere: their covers differ by less than five deviations of so many.
    cover = white[:, inside].mean(), white[:, ~inside].mean()
    assert abs(cover[0] - cover[1]) < 5 * np.sqrt(0.25 / (inside.sum() / 9))
    assert set(np.unique(film.frames)) == {128, 255}


def test_the_shape_moves_and_the_two_differ() -> None:
    film = Film(7, SHAPE_CONDITIONS["plain"])
    first, last = (np.argwhere(film.mask(0, t)).mean(0)[::-1] for t in (0, 29))
    assert last - first == pytest.approx(film.velocity * 30, abs=1.0)
    assert 0 < mask_iou(film.mask(0, 15), film.mask(1, 15)) < 1
    assert (Film(7, SHAPE_CONDITIONS["plain"]).frames == film.frames).all()


def test_figure_ground_is_ahead_of_flow() -> None:
    benchmark = shape_benchmark(("figure-ground", "dis"), ("noise",), 2, "tune")
    ours, flow = (task.work(Path())[0] for task in benchmark.tasks)
    assert ours["iou"] > flow["iou"]
    with pytest.raises(InputError, match="films"):
        shape_benchmark((), (), 0, "tune")


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
