"""The loop: frames go through any model once and in order, watchers see what they should, and it stops cleanly."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.run.pictures import PictureMaker
from ndtorch.run.run import run_model
from ndtorch.run.watchers import Picture, Watcher
from tests.run.stub_model import Count, StubModel, StubState


class Notes(Watcher):
    """Keeps everything that it is shown."""

    def __init__(self) -> None:
        self.pictures: list[Picture] = []
        self.times: list[float] = []
        self.weights: list[float] = []

    def picture(self, picture: Picture) -> None:
        self.pictures.append(picture)

    def signals(self, signals: Any, weights: torch.Tensor, state: Any) -> None:
        self.times += signals.time.tolist()
        self.weights.append(float(weights[0, 0]))


def test_every_frame_goes_through_once_and_is_reported() -> None:
    reported: list[int] = []
    notes = Notes()
    result = run_model(StubModel(), Count(23), pictures_per_second=2, watchers=(notes,), report=reported.append)
    assert (result.model, result.source, result.frames, result.interrupted) == ("stub", "count", 23, False)
    assert result.simulated_seconds == pytest.approx(2.3)
    assert sum(reported) == 23
    assert notes.times == pytest.approx([n / 10 for n in range(23)])
    assert notes.weights[-1] == result.final_weights[0, 0] == 23
    assert result.outputs.times.tolist() == pytest.approx(notes.times)
    assert result.outputs.samples[:, 0].tolist() == list(range(23))
    assert result.table is None


def test_pictures_come_at_their_rate_with_the_frame_and_what_is_in_sight() -> None:
    notes = Notes()
    run_model(StubModel(), Count(23), pictures_per_second=2, watchers=(notes,))
    assert [picture.time for picture in notes.pictures] == pytest.approx([0.4, 0.9, 1.4, 1.9])
    for picture, number in zip(notes.pictures, (4, 9, 14, 19), strict=True):
        assert (picture.frame == number).all()
        assert picture.frame.shape == (16, 16, 3)
        assert picture.enhanced is None
        assert [thing.place for thing in picture.objects] == [(number, 4)]


def test_ctrl_c_keeps_what_was_computed() -> None:
    result = run_model(StubModel(), Count(100, broken=40), pictures_per_second=1)
    assert result.interrupted
    assert result.frames == 40
    assert result.objects[0].place == (39.0, 4.0)
    with pytest.raises(KeyboardInterrupt):
        run_model(StubModel(), Count(100, broken=0))


def test_outputs_that_are_no_numbers_end_the_run_at_the_last_that_were() -> None:
    result = run_model(StubModel(breaks=20), Count(100), pictures_per_second=1)
    assert (result.verdict, result.objects) == ("alternating", [])
    assert result.frames == int(result.state.frames) == 20


def test_no_frame_and_one_frame_are_refused() -> None:
    with pytest.raises(InputError, match="no frames"):
        run_model(StubModel(), Count(0))
    with pytest.raises(InputError, match="one frame cannot show motion"):
        run_model(StubModel(), Count(1))
    # One more frame of a run that goes on is fine.
    assert run_model(StubModel(), Count(6), StubState(torch.tensor(5)), start=5).frames == 1


def test_what_is_soon_a_part_of_another_object_has_no_number() -> None:
    """Objects are numbered from 1 in the order in which they appear, once they have lasted for a second."""
    maker = PictureMaker(SimpleNamespace(tracks=True), 0.1)
    for n in range(30):
        labels = torch.zeros(1, 4, 4, dtype=torch.int32)
        labels[0, 0, 0] = 7 if n < 8 else 0
        labels[0, 1, 1] = 5
        labels[0, 2, 2] = 9 if n > 12 else 0
        maker.appeared(SimpleNamespace(labels=labels, mask=labels > 0, time=torch.tensor([n / 10])))
    assert maker.numbers == {4: 1, 8: 2}
