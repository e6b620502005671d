"""Scores of windows over retinotopic signals: which scenes are drawn, when they are read, and that bars are found."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from ndtorch.binding import ObjectFiles
from ndtorch_train.score import retinotopic as score
from ndtorch_train.score.local_bars import EVERY, FIELDS, SPACING
from ndtorch_train.score.scenes import FPS


@pytest.mark.parametrize("chosen", score.SETS, ids=lambda chosen: chosen.name)
def test_scenes_are_drawn_as_the_set_says(chosen: score.LocalSet) -> None:
    scenes = score.drawn(chosen, "tune", 6)
    assert {len(scene.bars) for scene in scenes} == set(chosen.bars)
    for scene in scenes:
        if chosen.restriction.same_color:
            assert len({bar.color for bar in scene.bars}) == 1
        if chosen.restriction.same_direction:
            assert len({(bar.direction, bar.orientation) for bar in scene.bars}) == 1
    assert {scene.seed for scene in scenes}.isdisjoint(s.seed for s in score.drawn(chosen, "test", 6))


def test_objects_are_read_after_the_samples_that_were_asked_for() -> None:
    """Two things a few fields apart: one goes right, upright and red; one up, lying and green."""
    t = torch.arange(140)
    signals = torch.zeros(1, len(t), FIELDS, FIELDS, 10)
    for (row, column), features, period in (((4, 4), (0, 4, 7), 17), ((11, 10), (1, 5, 8), 23)):
        light = 20 * (1.5 + torch.sin(t * 2 * torch.pi / period))
        for feature in features:
            signals[0, :, row, column, feature] = light
    windows = ObjectFiles((FIELDS, FIELDS), SPACING, EVERY / FPS)
    with torch.inference_mode():
        readings = score.found(windows, iter(signals.split(16, 1)), [1, 140])
    assert len(readings) == 2
    early, late = (reading[0] for reading in readings)
    assert len(early) == 0
    assert late.shape == (2, 10)


def test_rows_have_a_name_a_time_and_a_score_for_every_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    signals = torch.zeros(1, 20, FIELDS, FIELDS, 10)
    monkeypatch.setattr(score, "SETTLE", 0.3)
    monkeypatch.setattr(score, "local_bars", lambda folder: torch.zeros(()))
    monkeypatch.setattr(score, "local_sums", lambda part, seconds, table: iter([signals.expand(len(part), *[-1] * 4)]))
    rows = list(score.retinotopic_rows("tune", 3, (0.5, 0.2), tmp_path))
    sets = [(chosen.name, 0.2) for chosen in score.SETS]
    assert [(row.test, row.seconds) for row in rows] == [("random", 0.2), ("random", 0.5), *sets[1:]]
    for row in rows:
        assert [(s.found, s.ok) for s in row.scores] == [(0, False)] * 3
