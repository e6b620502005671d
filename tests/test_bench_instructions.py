"""What a kernel was called with, and the sums of callgrind."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from ndtorch.navigation import Avoider, StereoRig
from tests.benchmarks.bench_instructions import given_to, totals


def test_keeps_what_the_last_call_was_given() -> None:
    pytest.importorskip("numba")
    frames = np.random.default_rng(0).integers(0, 256, (3, 2, 480, 640, 3), dtype=np.uint8)

    def work() -> None:
        avoider, state = Avoider(StereoRig(), 1 / 30), None
        for left, right in frames:
            _, state = avoider(left, right, state)

    kept = given_to(["avoid"], work)
    assert list(kept) == ["avoid"]
    pictures = [x for x in pickle.loads(kept["avoid"]) if isinstance(x, np.ndarray) and x.dtype == np.uint8]
    assert [np.array_equal(picture, frame) for picture, frame in zip(pictures, frames[2], strict=True)] == [True, True]


def test_reads_the_sum_of_a_dump(tmp_path: Path) -> None:
    (tmp_path / "counts.1").write_text("version: 1\nevents: Ir\nfn=(1) a\n12 5\nsummary: 1234\ntotals: 1234\n")
    assert totals(tmp_path / "counts.1") == 1234
    (tmp_path / "counts.2").write_text("version: 1\n")
    with pytest.raises(RuntimeError, match="no sum of instructions"):
        totals(tmp_path / "counts.2")
