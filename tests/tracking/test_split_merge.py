"""Who goes where when a group parts."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.tracking.association import Association
from ndtorch.tracking.blobs import Blobs
from ndtorch.tracking.masks import Detection
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.split_merge import resolve_splits
from ndtorch.tracking.track import PARKED_S, PLACE, Track, TrackState
from ndtorch.tracking.tracker import add_detection

HEIGHT, SIDE = 100, 20
RED, GREEN = np.array([0.8, 0.2, 0.2]), np.array([0.2, 0.7, 0.2])
NOW = 2.0


def track(number: int, column: float, color: np.ndarray, seconds: float = 1.5, parked: bool = False) -> Track:
    """An object of a fifth of the picture that stood at one place until now."""
    one = Track.begin(number, 0.0, np.array([0.5, column]))
    one.state, one.extent, one.color = TrackState.CONFIRMED, 2 * (SIDE / HEIGHT,), color
    if parked:
        one.state, one.last_moved = TrackState.STATIONARY, NOW - 1.01 * PARKED_S
    for time in (NOW - 0.04 - seconds, NOW - 0.04):
        box = (0.4, column - 0.1, 0.6, column + 0.1)
        one.new_detections.append((time, 0.5, column, *box, (SIDE / HEIGHT) ** 2, 0.5, column))
    return one


def scene(*things: tuple[int, np.ndarray]) -> tuple[Blobs, np.ndarray]:
    """Squares by their left edges and colors."""
    labels, picture = np.zeros((HEIGHT, 160), np.int32), np.full((3, HEIGHT, 160), 0.5, np.float32)
    boxes = []
    for n, (left, color) in enumerate(things):
        labels[40:60, left : left + SIDE] = n + 1
        picture[:, 40:60, left : left + SIDE] = color[:, None, None]
        boxes.append([40, left, 60, left + SIDE])
    return Blobs(labels, np.array(boxes), np.full(len(things), SIDE**2)), picture


def split_blobs(ones: list[Track], *things: tuple[int, np.ndarray], **options: float) -> dict[int, list[int]]:
    """Both tracks met the first region."""
    regions, picture = scene(*things)
    given = {0: [0, 1], **{r: [] for r in range(1, len(things))}}
    resolve_splits(ones, Association(given, {}), regions, picture, NOW, TrackingParams(**options))
    return given


def test_the_one_whose_color_it_has_leaves_for_it() -> None:
    ones = [track(0, 0.6, RED), track(1, 0.65, GREEN)]
    assert split_blobs(ones, (45, GREEN), (68, RED)) == {0: [1], 1: [0]}
    # By place alone the other one.
    assert split_blobs(ones, (45, GREEN), (68, RED), split_color_cost=0.0) == {0: [0], 1: [1]}


def test_of_one_color_the_nearer_one_leaves() -> None:
    assert split_blobs([track(0, 0.6, RED), track(1, 0.65, RED)], (45, RED), (68, RED)) == {0: [0], 1: [1]}


@pytest.mark.parametrize(
    ("ones", "left"),
    [
        ([track(0, 0.6, RED), track(1, 0.65, GREEN, seconds=0.5)], 68),
        ([track(0, 0.6, RED), track(1, 0.65, GREEN)], 130),
    ],
    ids=["one that has just come", "a region far away"],
)
def test_nobody_leaves(ones: list[Track], left: int) -> None:
    assert split_blobs(ones, (45, RED), (left, GREEN)) == {0: [0, 1], 1: []}


def test_a_parked_one_does_not_leave_with_what_passes() -> None:
    ones = [track(0, 0.6, RED), track(1, 0.65, GREEN, parked=True)]
    assert split_blobs(ones, (45, GREEN), (68, RED)) == {0: [1], 1: [0]}
    assert split_blobs(ones, (45, RED), (68, GREEN)) == {0: [0, 1], 1: []}


@pytest.mark.parametrize(("parked", "follows"), [(True, 0.0), (False, 0.3)])
def test_in_a_shared_blob_a_parked_one_keeps_its_place(parked: bool, follows: float) -> None:
    one = track(1, 0.6, GREEN, parked=parked)
    seen = Detection((0.5, 0.65), (0.5, 0.65), (0.2, 0.3), 0.06, GREEN, np.zeros(4), 0.0, True)
    add_detection(one, NOW, seen, 1.6, TrackingParams())
    assert one.last[PLACE] == pytest.approx((0.5, 0.6 + follows * 0.05))


def test_of_two_that_came_as_one_the_one_that_stays_is_an_object_too() -> None:
    fps, size, color = 12.5, (72, 96), (200, 60, 50)
    film = 105 + np.random.default_rng(0).normal(0, 1, (round(8 * fps), *size, 3))
    for n, image in enumerate(film):
        column, row = max(0, round(min(44, 24 * n / fps - 20))), 26 - round(24 * max(0.0, n / fps - 5))
        image[46:58, column : column + 12] = color
        # The larger one, which goes on, takes the track along.
        image[max(0, row) : max(0, row + 20), column : column + 12] = color
    model = ndtorch.load("foreground", size=size, fps=fps)
    _, state = model(torch.from_numpy(film.astype(np.uint8)).permute(0, 3, 1, 2))
    paths = [at for one in model.objects(state) for at in one.path]
    there = {round(time * fps) for time, *at in paths if math.dist(at, (50, 52)) < 4}
    assert there >= set(range(round(6.5 * fps), len(film)))
