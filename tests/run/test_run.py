"""A model over a source, and the options of a run."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.run.options import KNOWN_BY, BindJob, check_options, check_resume, default_model, flag
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


VALUES: dict[str, Any] = {
    "rule": "hebbian",
    "order": "printed",
    "gamma": 1.0,
    "settle": 1.0,
    "first_stage_radius": 0.5,
    "fit": "stretch",
}


def test_the_default_model_is_that_of_the_kind_of_source() -> None:
    assert default_model("two-bars") == "scale-free"
    for place in ("clip.mp4", "frames", "camera:0", "rtsp://10.0.0.1/stream"):
        assert default_model(place) == "foreground"


@pytest.mark.parametrize("option", sorted(KNOWN_BY))
@pytest.mark.parametrize("model", ["published", "scale-free", "retinotopic", "foreground"])
def test_a_model_takes_its_own_options_and_names_the_models_of_others(option: str, model: str) -> None:
    job = BindJob(**{option: VALUES[option]})
    if model in KNOWN_BY[option]:
        check_options(job, model)
        return
    with pytest.raises(InputError) as error:
        check_options(job, model)
    assert str(error.value) == f"{flag(option)} is an option of {', '.join(KNOWN_BY[option])}; the model is {model}"


def test_a_resumed_run_keeps_its_model_its_source_and_its_making() -> None:
    job = BindJob(resume=Path("out/run"))
    check_resume(job, "clip.mp4", None, "foreground")
    check_resume(dataclasses.replace(job, source="clip.mp4"), "clip.mp4", "foreground", "foreground")
    for options, asked, word in (
        ({"settle": 1.0}, None, "--settle"),
        ({"fit": "stretch"}, None, "--fit"),
        ({"source": "other.mp4"}, None, "other.mp4"),
        ({}, "published", "published"),
    ):
        with pytest.raises(InputError, match=word):
            check_resume(dataclasses.replace(job, **options), "clip.mp4", asked, "foreground")
