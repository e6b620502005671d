"""Scores of ranges: every kind of truth is read, and the table tells right from wrong."""

from __future__ import annotations

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from ndtorch.cli.commands import main
from ndtorch_train.benchmark.ranges import CONDITIONS, Found, judge, pair_folders, read_pair

SHIFT, SIZE = 20, (24, 220)


def write_pair(folder: Path, truth: str = "disp_left.tif", disparity: float = SHIFT) -> Path:
    folder.mkdir(parents=True)
    wide = np.random.default_rng(3).integers(20, 230, (SIZE[0], SIZE[1] + SHIFT), dtype=np.uint8)
    wide = cv2.blur(wide, (3, 3))
    cv2.imwrite(str(folder / "left.png"), wide[:, : SIZE[1]])
    cv2.imwrite(str(folder / "right.png"), wide[:, SHIFT:])
    values = np.full(SIZE, disparity, np.float32)
    values[:, 110:] = 0
    scale = {"disp_left.tif": 1, "disparity_x2.png": 2, "disp_occ.png": 256}[truth]
    kind = {1: np.float32, 2: np.uint8, 256: np.uint16}[scale]
    cv2.imwrite(str(folder / truth), (values * scale).astype(kind))
    return folder


@pytest.mark.parametrize("truth", ["disp_left.tif", "disparity_x2.png", "disp_occ.png"])
def test_every_kind_of_truth_is_read(tmp_path: Path, truth: str) -> None:
    pair = read_pair(write_pair(tmp_path / "pair", truth))
    assert pair.truth[:, :110] == pytest.approx(SHIFT)
    assert not pair.truth[:, 110:].any()
    assert pair_folders(tmp_path) == [tmp_path / "pair"] == pair_folders(tmp_path / "pair")


def test_shares_are_of_what_is_known() -> None:
    truth = np.array([[10, 10, 10, 0]], np.float32)
    found = Found(np.zeros(4, np.int64), np.arange(4), np.array([10.5, 11.5, 14.0, 3.0]), 2, 0.0)
    row = judge(found, truth)
    assert (row["per_row"], row["known_per_row"]) == (2.0, 1.5)
    assert [row[key] for key in ("within_1", "within_2", "within_10")] == pytest.approx([1 / 3, 2 / 3, 1 / 3])


def test_conditions_change_what_they_say(tmp_path: Path) -> None:
    pair = read_pair(write_pair(tmp_path / "pair"))
    (left, right), (again, _) = CONDITIONS[3].views(pair, 2, 0)
    assert not np.array_equal(left, again)
    assert right.mean() / pair.right.mean() == pytest.approx(0.9, abs=0.02)
    assert (left - pair.left.astype(float)).std() == pytest.approx(2.55, abs=0.4)


def test_the_command_scores_pairs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_pair(tmp_path / "pairs" / "right")
    write_pair(tmp_path / "pairs" / "wrong", disparity=2 * SHIFT)
    out = tmp_path / "out"
    words = f"benchmark ranges {tmp_path / 'pairs'} --disparities 8 48 --jobs 1 --out {out}"
    assert main(words.split()) == 0
    with (out / "ranges.csv").open() as file:
        rows = {(row["case"], row["method"]): row for row in csv.DictReader(file)}
    assert len(rows) == 2 * len(CONDITIONS) * 3
    search = rows["right, as it is", "search"]
    assert float(search["within_10"]) == 1 == float(search["within_1"])
    assert float(search["per_row"]) > float(search["known_per_row"]) > 3
    assert float(rows["wrong, as it is", "search"]["within_10"]) == 0
    assert (out / "report.html").is_file()
    assert (out / "pair-001.png").is_file()
    assert "all pairs" in capsys.readouterr().out
