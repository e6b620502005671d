"""Methods on sets of scenes, and the command that runs them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from ndtorch.cli.commands import main
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
    words = [
        "benchmark",
        "scenes",
        "--methods",
        "scale-free",
        "greedy",
        "--scenes",
        "3",
        "--seconds",
        "2",
        "--jobs",
        "1",
    ]
    assert main([*words, "--out", str(out), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["method"], row["seconds"]) for row in rows] == [("scale-free", 2), ("greedy", 2)]
    assert "| random | scale-free | yes | 2 |" in (out / "scenes.md").read_text(encoding="utf-8")
    assert len((out / "scenes.csv").read_text(encoding="utf-8").splitlines()) == 3
    assert (out / "scores.png").stat().st_size > 5000
    assert "Split tune" in (out / "report.html").read_text(encoding="utf-8")
