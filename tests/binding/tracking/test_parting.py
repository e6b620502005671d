"""Who goes where when a group parts."""

from __future__ import annotations

import numpy as np
import pytest

from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.figures import Figure
from ndtorch.binding.tracking.following import start
from ndtorch.binding.tracking.parting import NEVER, assigned, parting
from ndtorch.binding.tracking.regions import Regions

HEIGHT, SIDE = 100, 20
RED, GREEN = np.array([0.8, 0.2, 0.2]), np.array([0.2, 0.7, 0.2])
NOW = 2.0


def track(number: int, column: float, color: np.ndarray, seconds: float = 1.5) -> Figure:
    """An object of a fifth of the picture that stood at one place until now."""
    one = start(number, 0.0, np.array([0.5, column]))
    one.known, one.extent, one.color = True, np.full(2, SIDE / HEIGHT), color
    for time in (NOW - 0.04 - seconds, NOW - 0.04):
        box = (0.4, column - 0.1, 0.6, column + 0.1)
        one.late.append((time, 0.5, column, *box, (SIDE / HEIGHT) ** 2, 0.5, column))
    return one


def scene(*things: tuple[int, np.ndarray]) -> tuple[Regions, np.ndarray]:
    """Squares by their left edges and colors."""
    labels, picture = np.zeros((HEIGHT, 160), np.int32), np.full((3, HEIGHT, 160), 0.5, np.float32)
    boxes = []
    for n, (left, color) in enumerate(things):
        labels[40:60, left : left + SIDE] = n + 1
        picture[:, 40:60, left : left + SIDE] = color[:, None, None]
        boxes.append([40, left, 60, left + SIDE])
    return Regions(labels, np.array(boxes), np.full(len(things), SIDE**2)), picture


def parted(ones: list[Figure], *things: tuple[int, np.ndarray], **options: float) -> dict[int, list[int]]:
    """Both tracks met the first region."""
    regions, picture = scene(*things)
    given = {0: [0, 1], **{r: [] for r in range(1, len(things))}}
    parting(ones, given, {}, regions, picture, NOW, FigureParams(**options))
    return given


def test_the_one_whose_color_it_has_leaves_for_it() -> None:
    ones = [track(0, 0.6, RED), track(1, 0.65, GREEN)]
    assert parted(ones, (45, GREEN), (68, RED)) == {0: [1], 1: [0]}
    # By place alone the other one.
    assert parted(ones, (45, GREEN), (68, RED), known_by=0.0) == {0: [0], 1: [1]}


def test_of_one_color_the_nearer_one_leaves() -> None:
    assert parted([track(0, 0.6, RED), track(1, 0.65, RED)], (45, RED), (68, RED)) == {0: [0], 1: [1]}


@pytest.mark.parametrize(
    ("ones", "left"),
    [
        ([track(0, 0.6, RED), track(1, 0.65, GREEN, seconds=0.5)], 68),
        ([track(0, 0.6, RED), track(1, 0.65, GREEN)], 130),
    ],
    ids=["one that has just come", "a region far away"],
)
def test_nobody_leaves(ones: list[Figure], left: int) -> None:
    assert parted(ones, (45, RED), (left, GREEN)) == {0: [0, 1], 1: []}


def test_one_stays_and_each_region_gets_one_at_most() -> None:
    left = np.array([[0.1, 0.2], [0.3, NEVER], [0.9, 0.8]], np.float32)
    # 0.2 + 0.3 to leave and 1 to stay: less than any other way.
    assert assigned(left, np.ones((3, 1), np.float32)) == [(0, 1), (1, 0)]
    # The second would rather stay.
    stay = np.array([[1.0], [0.1], [1.0]], np.float32)
    assert assigned(left, stay) == [(0, 0), (2, 1)]
    assert assigned(left[:2, :1], stay[:2]) == [(0, 0)]
    assert assigned(np.full((2, 1), NEVER, np.float32), stay[:2]) == []
