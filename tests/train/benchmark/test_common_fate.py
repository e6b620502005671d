"""Scores of patches of moving dots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch.scenes import CommonFate
from ndtorch_train.benchmark.common_fate import CONDITIONS, FIRST_SEED, METHODS, Found, fate_benchmark, scored
from ndtorch_train.benchmark.foreground import mask_iou
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
