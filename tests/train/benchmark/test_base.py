"""Tables of benchmarks, and ranges on stereo pairs."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.scenes import three_bars
from ndtorch.vision import GROUPS
from ndtorch_train.benchmark.base import Benchmark, Column, Row, Task
from ndtorch_train.benchmark.ranges import Found, judge, pair_folders, read_pair, spoiled
from ndtorch_train.superposed import Stimuli, rendered_sums

COLUMNS = (Column("case", "case"), Column("method", "method"), Column("f", "F", 2, better=1), Column("n", "n"))


def work(name: str, value: float | None, folder: Path) -> list[Row]:
    with (folder / "runs").open("a") as file:
        file.write(name)
    if name == "d":
        raise ValueError("of no use")
    return [{"case": "one", "method": name, "f": value, "n": 3}]


def made(names: str) -> Benchmark:
    tasks = [Task(name, functools.partial(work, name, n / 4)) for n, name in enumerate(names)]
    return Benchmark("toy", "Toys", "A note.", COLUMNS, tasks)


def test_the_best_of_a_case_is_bold_and_what_is_missing_is_a_dash(tmp_path: Path) -> None:
    rows, text, folder, failed = made("abc").run(tmp_path / "out", 1, False, print)
    assert [row["f"] for row in rows] == [0.0, 0.25, 0.5]
    assert "| one | c | **0.50** | 3 |" in text
    assert Column("g", "G").cell({"g": None}) == "-"
    assert (folder / "toy.csv").read_text().splitlines()[:2] == ["case,method,f,n", "one,a,0,3"]
    assert (folder / "report.html").is_file()
    assert not failed


def test_finished_rows_are_kept(tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = made("ab").run(out, 1, False, print)
    again = made("ab").run(out, 1, False, print)
    assert again[:3] == first[:3]
    assert (out / "runs").read_text() == "ab"
    (out / "rows.jsonl").write_text((out / "rows.jsonl").read_text()[:-9])  # the last line was cut off
    assert made("ab").run(out, 1, False, print).rows == first.rows
    assert (out / "runs").read_text() == "abb"
    assert len(made("abc").run(out, 1, False, print).rows) == 3
    assert (out / "runs").read_text() == "abbc", "another task: that alone"


def test_tasks_run_in_parallel_and_failures_leave_the_others(tmp_path: Path) -> None:
    rows, _, _, failed = made("abd").run(tmp_path / "out", 2, False, print)
    assert [row["method"] for row in rows] == ["a", "b"]
    assert list(failed) == ["d"]
    assert "of no use" in failed["d"]


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
    pair, rng = read_pair(write_pair(tmp_path / "pair")), np.random.default_rng(0)
    assert spoiled(pair.right, 0.0, 0.9, rng).mean() / pair.right.mean() == pytest.approx(0.9, abs=0.02)
    assert (spoiled(pair.left, 0.01, 1.0, rng) - pair.left.astype(float)).std() == pytest.approx(2.55, abs=0.4)


def test_a_model_is_written_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["first-stage", "--radius", "0.1", "--out", str(tmp_path / "mine"), "--json"]
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out)["folder"] == str(tmp_path / "mine")
    before = (tmp_path / "mine" / "weights.safetensors").stat().st_mtime_ns
    assert main(command) == 2
    assert "config.toml exists; --force replaces it" in capsys.readouterr().err
    assert (tmp_path / "mine" / "weights.safetensors").stat().st_mtime_ns == before
    assert main([*command, "--force"]) == 0
    assert (tmp_path / "mine" / "weights.safetensors").stat().st_mtime_ns > before


def test_superposed_sums_are_those_of_the_rendered_scene(bars: Stimuli) -> None:
    """At a phase and offset that were never filmed; after the filters have settled."""
    want = rendered_sums(three_bars(3.6, phase=77.0, blue_offset=33.0))[300:]
    got = bars.red(3.6) + bars.green([77.0], 3.6)[0] + bars.blue([33.0], 3.6)[0]
    error = (got[300:] - want).abs().amax(0) / want.amax()
    by_feature = (got[300:] - want).abs().amax(0) / want.amax(0)
    assert by_feature[[0, 1, 2]].max() < 0.015  # motion to the left, right and down
    assert error[3] < 1e-3  # nothing moves up
    assert by_feature[GROUPS["orientation"]].max() < 0.08  # orientation: filters of bars overlap
    assert by_feature[GROUPS["color"]].max() < 0.002


def test_films_repeat_with_the_period_of_the_shadow(bars: Stimuli) -> None:
    sums = bars.bars[0].at(torch.tensor([10.0, 60.0]), 2.0)
    torch.testing.assert_close(sums[0], sums[1], rtol=1e-4, atol=1e-3)
    later = bars.bars[2].at(torch.tensor(0.0), 3.0)
    torch.testing.assert_close(later[:100], later[100:200], rtol=1e-3, atol=1e-2)
