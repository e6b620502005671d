"""The page of a run, and what it says in words."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from ndtorch.binding import BoundObject, Verdict, bound_objects, object_table
from ndtorch.report.films import mark_of
from ndtorch.report.page import Page, Shown, Table
from ndtorch.report.words import in_words, summary
from ndtorch.run.result import RunResult, Trace
from ndtorch.scenes.video_writer import VideoWriter


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report with a picture and a film, alone in a folder."""
    import cv2

    folder = tmp_path_factory.mktemp("files")
    cv2.imwrite(str(folder / "a.png"), np.full((300, 900, 3), 200, dtype=np.uint8))
    with VideoWriter(folder / "b.mp4", 12.5, (64, 96)) as film:
        for n in range(10):
            film.write(torch.full((3, 64, 96), 0.1 * n))
    shown = [
        Shown(folder / "a.png", "A picture", "grey"),
        Shown(folder / "b.mp4", "A film", "brighter"),
        Shown(folder / "none.png", "Nothing", "not there"),
    ]
    table = Table("A table", [f"column {n}" for n in range(20)], [["a wide cell"] * 20])
    out = tmp_path_factory.mktemp("page")
    return Page("<b> & co", ["2 objects"], "ndtorch bind x", {"model": "published"}, [table], shown).write(out)


def test_one_file_holds_everything_and_nothing_is_fetched(written: Path) -> None:
    text = written.read_text(encoding="utf-8")
    assert [path.name for path in written.parent.iterdir()] == ["report.html"]
    assert "&lt;b&gt; &amp; co" in text
    assert "Nothing" not in text
    assert "ndtorch bind x" in text
    addresses = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert len(addresses) == 3
    assert all(address.startswith("data:") for address in addresses)


def run_of(objects: list[BoundObject], verdict: Verdict = "stable", owners: bool = True) -> RunResult:
    table = object_table(torch.zeros(10, 10)) if owners else None
    blank = Trace((10,)), Trace((10, 10)), np.zeros((10, 10), np.float32)
    return RunResult(
        "clip", "published", (60, 80), objects, verdict, table, None, 0.0, 3.0, 1.5, 30, *blank, interrupted=False
    )


CAR = BoundObject(
    "red",
    7,
    {"red": 1.0, "right": 0.5},
    place=(40.0, 30.0),
    first_seen=1.0,
    last_seen=2.0,
    track=0,
    heading=(1.0, 0.0),
    path=((1.0, 8.0, 30.0), (1.1, 12.0, 30.0), (1.2, 16.0, 30.0), (2.0, 40.0, 30.0)),
)


def test_an_object_has_one_number_in_words_files_and_overlay() -> None:
    later = replace(CAR, track=10, number=2)
    result = run_of([CAR, later], owners=False)
    assert "object 2:" in in_words(result)
    assert [thing["object"] for thing in summary(result)["objects"]] == [1, 2]
    assert mark_of(later) == "#2"


def test_an_object_with_a_time_is_told_with_it() -> None:
    result = run_of([CAR], owners=False)
    assert "object 1:   1.0 -   2.0 s  red, moving right" in in_words(result)
    assert "verdict" not in in_words(result)
    (thing,) = json.loads(json.dumps(summary(result)))["objects"]
    assert thing == {
        "object": 1,
        "color": "red",
        "direction": "right",
        "appeared": 1.0,
        "disappeared": 2.0,
        "neuron": "red",
        "features": {"red": 1.0, "right": 0.5},
        # Shares of height and width, five a second at most.
        "path": [[1.0, 0.5, 0.1], [1.2, 0.5, 0.2], [2.0, 0.5, 0.5]],
    }


def test_owners_are_told_by_their_features_and_a_table() -> None:
    weights = torch.zeros(10, 10)
    weights[[1, 2, 4, 6], 7] = torch.tensor([0.8, 0.6, 0.4, 0.3])
    result = run_of(bound_objects(object_table(weights)))
    text = in_words(result)
    assert "object 1: red, moving right and down, orientation between 0° and 120°" in text
    assert "red           .   1.00   0.75" in text
    assert summary(result)["objects"] == [{"neuron": "red", "features": result.objects[0].features}]


@pytest.mark.parametrize(
    ("verdict", "word"),
    [("learning", "no weight has grown"), ("static", "nothing fluctuates"), ("alternating", "flip")],
)
def test_nothing_found_is_said_with_the_reason(verdict: Verdict, word: str) -> None:
    text = in_words(run_of([], verdict))
    assert "no objects" in text
    assert word in text
