"""The command scores models and peers on clips in one table."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from ndtorch.cli.commands import main
from tests.train.benchmark.test_mot import write_clip


@pytest.mark.parametrize("kind", ["boxes", "masks"])
def test_model_and_peers_are_in_one_table(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("norfair")
    pytest.importorskip("supervision")
    write_clip(tmp_path / "square", kind)
    methods = ["foreground", "mog2-norfair", "knn-bytetrack"]
    out = tmp_path / "out"
    words = ["benchmark", "foreground", str(tmp_path), "--jobs", "1", "--out", str(out), "--methods", *methods]
    assert main(words) == 0
    with (out / "foreground.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["method"] for row in rows] == methods
    assert {row["clip"] for row in rows} == {"square"}
    for row in rows:
        assert float(row["f"]) > (0.5 if row["method"] != "foreground" else -1)
        assert (row["idf1"] == "") == (kind == "masks")
        assert float(row["ms_per_frame"]) > 0
    assert "square" in (out / "report.html").read_text(encoding="utf-8")


def test_generated_clips_have_a_row_for_each_number_of_objects(tmp_path: Path) -> None:
    words = ["--generated", "1", "--counts", "0", "1", "--fps", "12.5", "--methods", "foreground", "--jobs", "1"]
    assert main(["benchmark", "foreground", *words, "--out", str(tmp_path)]) == 0
    with (tmp_path / "foreground.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["clip"] for row in rows] == ["0 objects, 12.5/s, 0", "1 objects, 12.5/s, 0"]
    assert float(rows[1]["recall"]) > 0.5
