"""The papers' bars."""

from __future__ import annotations

import torch

from ndtorch_train.score.bars import bar_sets
from ndtorch_train.score.methods import first_stage


def features(*rows: str) -> torch.Tensor:
    """Bool rows from strings of 0 and 1."""
    return torch.tensor([[c == "1" for c in row] for row in rows], dtype=torch.bool).reshape(len(rows), 10)


def test_the_truth_of_the_papers_bars() -> None:
    two = bar_sets(1.0, first_stage())[0]
    assert two.sums.shape == (18, 100, 10)
    # Red: right, down, 0°, 120°; green: left, down, 0°, 60°. [B fig. 8]
    assert torch.equal(two.truth, features("0110101100", "1010110010"))
