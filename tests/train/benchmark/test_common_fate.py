"""Scores of patches of moving dots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch_train.benchmark.foreground import mask_iou
from ndtorch_train.benchmark.shape_identification import CONDITIONS as SHAPE_CONDITIONS
from ndtorch_train.benchmark.shape_identification import Condition, Film, shape_benchmark


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
