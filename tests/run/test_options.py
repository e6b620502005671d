"""What can be asked of a run, and which model knows what: said before anything is opened."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from ndtorch.errors import InputError
from ndtorch.run.options import KNOWN_BY, BindJob, check_options, check_resume, default_model, flag

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
