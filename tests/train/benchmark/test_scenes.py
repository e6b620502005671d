"""Methods on sets of scenes, their scores, and the command that runs them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch_train.benchmark.scene_scores import feature_f1, right_from, score_scene
from ndtorch_train.benchmark.scenes import paper_bars


def features(*rows: str) -> torch.Tensor:
    """Bool rows from strings of 0 and 1."""
    return torch.tensor([[c == "1" for c in row] for row in rows], dtype=torch.bool).reshape(len(rows), 10)


def test_the_truth_of_the_papers_bars() -> None:
    two = paper_bars("two bars", 1.0)
    assert two.sums.shape == (18, 100, 10)
    # Red: right, down, 0°, 120°; green: left, down, 0°, 60°. [B fig. 8]
    assert torch.equal(two.truth[0], features("0110101100", "1010110010"))


def test_the_command_writes_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = f"benchmark scenes --methods scale-free greedy --scenes 3 --seconds 2 --jobs 1 --out {out} --json"
    assert main(words.split()) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["method"], row["seconds"]) for row in rows] == [("scale-free", 2), ("greedy", 2)]
    assert "| random | scale-free | yes | 2 |" in (out / "scenes.md").read_text(encoding="utf-8")
    assert len((out / "scenes.csv").read_text(encoding="utf-8").splitlines()) == 3
    assert (out / "scores.png").stat().st_size > 5000
    assert "Split tune" in (out / "report.html").read_text(encoding="utf-8")


def test_f1_gives_objects_to_bars_as_fits_best() -> None:
    truth = features("1100000100", "0011000010")
    assert feature_f1(truth[[1, 0]], truth).tolist() == [1.0, 1.0]
    # One object for two bars: the other bar has 0. Two of three features right, one wrong: F1 = 2/3.
    assert feature_f1(features("1000100100"), truth).tolist() == pytest.approx([2 / 3, 0.0])
    assert feature_f1(truth[:0], truth).tolist() == [0.0, 0.0]


def test_a_scene_is_ok_when_counted_and_described() -> None:
    truth = features("1100000100", "0011000010")
    assert score_scene(truth, truth).ok
    surplus = score_scene(torch.cat([truth, truth[:1]]), truth)
    assert (surplus.counted, surplus.ok, surplus.f1) == (False, False, 1.0)
    nothing = truth[:0]
    assert score_scene(nothing, nothing).ok
    assert not score_scene(truth, nothing).counted


def test_right_from_is_the_start_of_the_lasting_right_count() -> None:
    times = np.arange(1.0, 6.0)
    assert right_from(times, np.array([1, 2, 1, 2, 2]), 2) == 4.0
    assert right_from(times, np.array([2, 2, 2, 2, 2]), 2) == 1.0
    assert right_from(times, np.array([2, 2, 2, 2, 1]), 2) == math.inf
