"""Tracks of blobs: assignment, shared blobs, confirmation, stationary objects, ghosts."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from ndtorch.foreground.background import BackgroundParams, Segmentation, start_background
from ndtorch.foreground.colors import color_name
from ndtorch.foreground.tracker import (
    BOX,
    NUMBER,
    PLACE,
    STATUS,
    TIME,
    Status,
    TrackingParams,
    Tracks,
    kept_from_background,
    no_tracks,
    replace_ghosts,
    update,
)

SIZE, DT = (100, 160), 0.04
Square = tuple[float, float, float]
"""Column and row of the middle, and side, pixels."""


def seen(squares: Sequence[Square], contrast: float = 20.0) -> Segmentation:
    """A segmented frame of squares."""
    image, mask = np.full((3, *SIZE), 0.5, np.float32), np.zeros(SIZE, np.uint8)
    for column, row, side in squares:
        top, left = round(row - side / 2), round(column - side / 2)
        mask[max(top, 0) : top + round(side), max(left, 0) : left + round(side)] = 1
    image[:, mask > 0] = 0.9
    sigma = np.full(SIZE, 0.01, np.float32)
    return Segmentation(image, mask * np.float32(contrast) * sigma, sigma, mask, False)


def follow(
    frames: int, scene: Callable[[int], Sequence[Square]], contrast: float = 20.0, **options: float
) -> tuple[Tracks, list[Tracks]]:
    """The tracks after so many frames, and those that ended."""
    tracks, ended, count = no_tracks(), list[Tracks](), 0
    for n in range(frames):
        tracks, lost, labels = update(
            tracks, count, seen(scene(n), contrast), n * DT, 10 + n * DT, DT, TrackingParams(**options)
        )
        count = max(count, int(labels.max()))
        ended.append(lost)
    return tracks, ended


def path(tracks: Tracks, number: int) -> np.ndarray:
    return np.asarray(tracks.path[tracks.path[:, NUMBER] == number])


def test_a_row_is_what_was_measured_at_that_frame() -> None:
    tracks, _ = follow(40, lambda n: [(10 + 2 * n, 50, 12)])
    rows = path(tracks, 0)
    true = 10 + 2 * np.arange(40)
    assert rows[:, TIME] == pytest.approx(np.arange(40) * DT)
    assert rows[:, PLACE] * 100 == pytest.approx(np.stack([true, 0 * true + 50], 1), abs=1)
    assert rows[:, BOX] * 100 == pytest.approx(np.stack([true - 6, 0 * true + 44, true + 6, 0 * true + 56], 1))
    assert tracks.velocity[0] * 100 == pytest.approx([50, 0], abs=1)
    # Tentative until it has moved .7 of its size.
    known = rows[:, STATUS] == Status.MEASURED
    assert rows[known][0, TIME] == pytest.approx(max(0.3, 8.4 / 50), abs=DT)


def test_a_track_is_confirmed_by_age_travel_and_contrast() -> None:
    assert not follow(60, lambda n: [(50, 50, 12)])[0].confirmed.any()
    assert not follow(60, lambda n: [(50 + 4 * (n % 2), 50, 12)])[0].confirmed.any()
    assert not follow(40, lambda n: [(20 + 2 * n, 50, 12)], contrast=4.0)[0].confirmed.any()
    assert not follow(6, lambda n: [(20 + 4 * n, 50, 12)])[0].confirmed.any()
    assert follow(20, lambda n: [(20 + 2 * n, 50, 12)])[0].confirmed.all()
    assert follow(20, lambda n: [(50, 50, 12)], min_travel_sizes=0.0)[0].confirmed.all()


def test_two_that_cross_keep_their_numbers_and_share_a_blob() -> None:
    tracks, ended = follow(60, lambda n: [(20 + 2 * n, 46, 14), (140 - 2 * n, 54, 14)])
    assert not any(len(table.number) for table in ended)
    assert tracks.number.tolist() == [0, 1]
    assert tracks.place[:, 0] * 100 == pytest.approx([138, 22], abs=4)
    for number in (0, 1):
        rows = path(tracks, number)
        assert len(rows) == 60
        # Its part of the shared blob is about as large as it.
        shared = rows[rows[:, STATUS] == Status.PREDICTED]
        assert len(shared) > 3
        assert (shared[:, 7] - shared[:, 5]) * 100 == pytest.approx(14, abs=1.5)


def test_fragments_that_became_tracks_give_up_the_blob_that_they_share_for_long() -> None:
    def scene(n: int) -> Sequence[Square]:
        halves = [(20 + 2 * n, 40, 12), (20 + 2 * n, 56, 12)]
        return halves if n < 12 else [*halves, (20 + 2 * n, 48, 12)]

    tracks, ended = follow(70, scene)
    assert len(tracks.number) == 1
    assert sum(len(table.number) for table in ended) == 1
    assert path(tracks, int(tracks.number[0]))[-1, BOX] * 100 == pytest.approx([152, 34, 160, 62])


def test_a_gap_is_bridged_and_a_longer_one_ends_the_track() -> None:
    def scene(gap: int) -> Callable[[int], Sequence[Square]]:
        return lambda n: [] if 30 <= n < 30 + gap else [(10 + 2 * n, 50, 12)]

    tracks, _ = follow(60, scene(8))
    assert tracks.number.tolist() == [0]
    assert len(path(tracks, 0)) == 52
    tracks, ended = follow(62, scene(28))
    assert [table.number.tolist() for table in ended if len(table.number)] == [[0]]
    assert tracks.number.tolist() == [1]


def test_fragments_belong_to_their_object_and_begin_no_track() -> None:
    tracks, _ = follow(40, lambda n: [(20 + 2 * n, 40, 20), (20 + 2 * n, 56, 6)])
    assert tracks.number.tolist() == [0]
    assert follow(5, lambda n: [(20 + 2 * n, 40, 20), (100, 80, 8)])[0].number.tolist() == [0, 1]


def test_what_stops_is_stationary_and_is_kept_from_the_background_for_a_while() -> None:
    tracks, _ = follow(90, lambda n: [(10 + 2 * min(n, 30), 50, 12)])
    assert tracks.status.tolist() == [Status.STATIONARY]
    labels = np.zeros(SIZE, np.int32)
    labels[44:56, 64:76] = 1
    kept = kept_from_background(tracks, labels, 89 * DT, TrackingParams())
    assert kept[43:57, 63:77].all()
    assert kept.sum() == 14 * 14
    assert not kept_from_background(tracks, labels, 700.0, TrackingParams()).any()


def test_what_was_reported_stays() -> None:
    def scene(n: int) -> Sequence[Square]:
        return [(10 + 2 * n, 30, 12), (150 - 2 * n, 34, 14), *([(80, 70, 10 + n / 4)] if n > 20 else [])]

    early, late = (follow(n, scene)[0] for n in (40, 70))
    for number in early.number[early.confirmed].tolist():
        rows = path(early, number)
        assert np.array_equal(path(late, number)[: len(rows)], rows)


def test_a_ghost_is_learned_and_an_object_that_stands_is_not() -> None:
    picture = seen([(50, 50, 20)])
    state = start_background(picture.image, BackgroundParams())
    state.static_time[...], state.known[...] = 1.0, 1
    labels = (picture.mask * 1).astype(np.int32)
    empty = picture._replace(image=np.full_like(picture.image, 0.5))
    tracks, _ = follow(1, lambda n: [(50, 50, 20)])
    replace_ghosts(tracks, labels, empty, state, 0.5, TrackingParams())
    assert np.array_equal(state.mean, empty.image)
    replace_ghosts(tracks, labels, picture, state, 0.5, TrackingParams())
    assert np.array_equal(state.mean, empty.image)


@pytest.mark.parametrize(
    ("color", "name"),
    [
        ((0.9, 0.9, 0.9), "white"),
        ((0.05, 0.05, 0.05), "black"),
        ((0.4, 0.4, 0.4), "grey"),
        ((0.8, 0.3, 0.3), "red"),
        ((0.8, 0.7, 0.1), "yellow"),
        ((0.1, 0.6, 0.2), "green"),
        ((0.2, 0.3, 0.8), "blue"),
    ],
)
def test_colors_have_names_under_any_light(color: tuple[float, ...], name: str) -> None:
    light = np.array([1.0, 0.9, 0.7])
    background = (np.full((3, *SIZE), 0.5) * light[:, None, None]).astype(np.float32)
    background[:, :10, :10] = light[:, None, None]
    assert color_name(np.array(color) * light, background) == name
