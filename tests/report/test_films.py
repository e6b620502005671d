"""What is filmed of a run: objects marked where they are, sizes that a codec takes."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ndtorch.binding import BoundObject
from ndtorch.report.films import EnhancedVideo, Overlay, clocked, even, mark_of, marked
from ndtorch.report.plots.layout import rgb
from ndtorch.run.watchers import Picture

FRAME = np.zeros((60, 80, 3), dtype=np.uint8)


def thing(first_seen: float = 0.0, **more: object) -> BoundObject:
    kept = {"place": (30.0, 20.0), "first_seen": first_seen, "last_seen": 1.0, "heading": (1.0, 0.2)} | more
    return BoundObject("red", 7, {"red": 1.0, "right": 1.0}, **kept)  # type: ignore[arg-type]


def inked(image: np.ndarray, color: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the pixels of that color."""
    rows, columns = np.nonzero((image == np.array(color)).all(-1))
    return rows, columns


def test_an_object_is_marked_in_its_color_where_it_is_with_an_arrow_where_it_goes() -> None:
    image = marked(FRAME, (thing(),))
    rows, columns = inked(image, rgb("red"))
    assert len(rows) > 20
    assert abs(np.median(rows) - 20) <= 2
    assert rows.min() >= 13
    # The arrow sticks out to the right.
    assert columns.max() - 30 > 30 - columns.min()
    assert FRAME.max() == 0


@pytest.mark.parametrize("size", [(61, 81), (60, 80)])
def test_films_have_an_even_size_and_every_picture(size: tuple[int, int], tmp_path: Path) -> None:
    frame = np.zeros((*size, 3), dtype=np.uint8)
    overlay, enhanced = Overlay(tmp_path / "o.avi", 5, size), EnhancedVideo(tmp_path / "e.avi", 5, size)
    for number in range(3):
        overlay.picture(Picture(number / 5, frame, objects=(thing(),)))
        enhanced.picture(Picture(number / 5, frame, frame + 200, 7))
    overlay.close()
    enhanced.close()
    assert even(size) == (60, 80)
    for name, width in (("o", 80), ("e", 160)):
        film = cv2.VideoCapture(str(tmp_path / f"{name}.avi"))
        assert (film.get(cv2.CAP_PROP_FRAME_COUNT), film.get(cv2.CAP_PROP_FRAME_WIDTH)) == (3, width)
    _, picture = film.read()
    assert picture[:, 100:].mean() > 150 > picture[:, :60].mean()


def test_the_overlay_has_number_label_and_clock() -> None:
    frame = np.zeros((120, 160, 3), dtype=np.uint8)
    plain, numbered = marked(frame, (thing(),)), marked(frame, (thing(number=5),))
    assert mark_of(thing(number=5)) == "#5"
    assert (plain != numbered).any()
    clock = clocked(frame, 1.5)
    rows, _ = np.nonzero(clock.max(-1))
    assert rows.min() > 60
    assert (clock != clocked(frame, 2.5)).any()
    assert frame.max() == clocked(FRAME, 1.5).max() == 0  # no room for letters
