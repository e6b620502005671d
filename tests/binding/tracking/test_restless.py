"""What comes and goes and never becomes an object makes its place restless; what passes there has to go further."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.figures import Figure
from ndtorch.binding.tracking.following import start, travels
from ndtorch.binding.tracking.restless import at_rest, come_and_gone, restless
from ndtorch_train.benchmark.negative_clips import leaves
from tests.vision.camera.passing_scenes import SIZE, ground

P = FigureParams()
DT = 0.04


def track(
    number: int, left: float, right: float, seconds: float = 0.4, known: bool = False, size: float = 0.1
) -> Figure:
    """A track of a square that goes from left to right in the middle of the picture."""
    steps = round(seconds / DT)
    columns = np.linspace(left, right, steps)
    one = start(number, 0.0, np.array([0.5, columns[0]]))
    one.known, one.extent = known, np.full(2, size)
    for n, column in enumerate(columns.tolist()):
        box = (0.5 - size / 2, column - size / 2, 0.5 + size / 2, column + size / 2)
        one.late.append((n * DT, 0.5, column, *box, size**2, 0.5, column))
    return one


def test_counts_those_that_never_were_objects_and_forgets_them() -> None:
    before = at_rest(112, 199)
    gone = come_and_gone(before, [track(0, 0.3, 0.32), track(1, 0.3, 0.34)], [], DT, P)
    there, elsewhere = track(2, 0.31, 0.31), track(3, 1.2, 1.2)
    assert restless(there, gone) == pytest.approx(2, rel=0.3)
    assert restless(elsewhere, gone) == 0
    assert not before.any()
    for _ in range(round(P.forget / DT)):
        gone = come_and_gone(gone, [], [], DT, P)
    assert restless(there, gone) == pytest.approx(2 / np.e, rel=0.3)


@pytest.mark.parametrize(
    ("late", "open_"),
    [
        ([track(0, 0.3, 0.3, known=True)], []),
        ([track(0, 0.3, 0.3, seconds=2 * DT)], []),
        ([track(0, 0.3, 0.3)], [track(1, 0.4, 0.4, known=True)]),
    ],
    ids=["an object", "a glimpse", "a piece beside an object"],
)
def test_what_says_nothing_about_its_place(late: list[Figure], open_: list[Figure]) -> None:
    assert not come_and_gone(at_rest(112, 199), late, open_, DT, P).any()


def test_an_object_far_away_or_earlier_excuses_nothing() -> None:
    passed = track(1, 0.3, 0.3, known=True)
    passed.late = [(row[0] - 5, *row[1:]) for row in passed.late]
    gone = come_and_gone(at_rest(112, 199), [track(0, 0.3, 0.3)], [track(2, 1.3, 1.4, known=True), passed], DT, P)
    assert restless(track(3, 0.3, 0.3), gone) == pytest.approx(1, rel=0.3)


def test_where_others_came_and_went_one_has_to_go_further() -> None:
    quiet = at_rest(112, 199)
    gone = quiet + np.float32(1)
    short, long = track(0, 0.3, 0.3 + 1.5 * P.travel * 0.1), track(1, 0.3, 0.3 + 1.1 * P.wander * P.travel * 0.1)
    assert travels(short, quiet, DT, P)
    assert not travels(short, gone, DT, P)
    assert travels(long, gone, DT, P)


def test_outside_the_picture_and_as_large_as_it() -> None:
    gone = come_and_gone(at_rest(112, 199), [track(0, 0.0, 1.8, size=1.4)], [], DT, P)
    assert gone.shape == at_rest(112, 199).shape
    for left in (-0.2, 0.0, 1.77):
        assert np.isfinite(restless(track(1, left, left), gone))


@pytest.mark.slow
def test_a_thing_that_crosses_restless_ground_is_found() -> None:
    """Patches of leaves sway for 12 s. From 8 s on a bright square crosses them."""
    fps, count = 25, 300
    still = np.asarray(ground().permute(1, 2, 0).numpy())
    film = torch.stack([torch.from_numpy(frame) for frame in leaves(still, np.random.default_rng(6), count)])
    film = film.permute(0, 3, 1, 2).clamp(0, 1)
    for n in range(8 * fps, count):
        left = 2 * (n - 8 * fps)
        film[n, :, 44:68, left : left + 24] = 0.9
    # Without what tells leaves from things, leaves are objects.
    blind = {"tracking.restless": 1e9, "tracking.straight": 0.0, "tracking.swing": 0.0}
    blind |= {"tracking.many": 1e9, "tracking.crowded": 1e9}
    counts = []
    for options in ({}, blind):
        model = ndtorch.load("figures", size=SIZE, fps=fps, **options)
        with torch.inference_mode():
            _, state = model(film)
        objects = model.objects(state)
        assert any(one.heading[0] > 0.7 * SIZE[1] for one in objects)
        counts.append(len(objects))
    assert counts[0] == 1 < counts[1]
