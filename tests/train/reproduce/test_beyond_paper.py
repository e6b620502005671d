"""Better parts on claims that do not hold as published."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from ndtorch_train.reproduce import beyond_paper
from ndtorch_train.reproduce.experiment import Context
from ndtorch_train.reproduce.video import ParkingLot


def test_exactly_means_each_color_once() -> None:
    found = [["green", "red"], ["red"], ["red", "red"], ["red", "green", "blue"]]
    assert beyond_paper.exactly(found, ["red", "green"]) == [True, False, False, False]


def test_colors_at_are_those_of_the_moment() -> None:
    """A red object alone, and then a blue one in its place."""
    time = torch.arange(1200) / 100
    light = 0.5 + 0.4 * torch.sin(6.0 * time)
    red = torch.tensor([0, 1.0, 0, 0, 1.0, 0.2, 0.2, 1.0, 0.1, 0.1])
    blue = torch.tensor([1.0, 0, 0, 0, 0.2, 1.0, 0.2, 0.1, 0.1, 1.0])
    sums = light[:, None] * torch.where(time[:, None] < 6, red, blue)
    first, last = beyond_paper.colors_at(sums[None], [600, 1200])
    assert (first, last) == ([["red"]], [["blue"]])


@pytest.fixture
def context(tmp_path: Path) -> Context:
    return Context(tmp_path, tmp_path, True, lambda share: None)


def test_without_a_clip_the_road_is_left_out(context: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    class Still(ParkingLot):
        def __init__(self, settle: float, seconds: float, seed: int) -> None:
            super().__init__(settle, 0.2 - settle, seed)

    monkeypatch.setattr(beyond_paper, "ParkingLot", Still)
    outcome = beyond_paper.one_object(context, 0, "")
    assert outcome.ours == "stand-in: 0 (none)"
    assert outcome.verdict == "does not hold"
    assert "No road clip given" in outcome.why
