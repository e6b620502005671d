"""Rows of results, superposed sums, and the first stage as a command."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.loading import model_folders
from ndtorch.scenes import three_bars
from ndtorch.vision import GROUPS
from ndtorch_train.plots import draw_heat_map, draw_table
from ndtorch_train.rows import RowStore
from ndtorch_train.superposed import Bars, Stimuli
from tests.films import sums_of


def test_rows_are_read_as_they_were_kept(tmp_path: Path) -> None:
    store = RowStore(tmp_path / "rows")
    store.add({"a": [{"x": 1.5, "word": "one"}], "b": [{"x": float("nan")}]})
    assert store.rows == RowStore(tmp_path / "rows").rows == {"a": [{"x": 1.5, "word": "one"}], "b": [{"x": None}]}


def test_a_line_that_was_cut_off_does_not_count_and_the_next_one_does(tmp_path: Path) -> None:
    path = tmp_path / "rows"
    RowStore(path).add({"a": [{"x": 1}], "b": [{"x": 2}]})
    path.write_bytes(path.read_bytes()[:-5])
    store = RowStore(path)
    assert (list(store.rows), store.damaged) == (["a"], 1)
    store.add({"c": [{"x": 3}]})
    assert list(RowStore(path).rows) == ["a", "c"]


def test_a_damaged_line_is_never_believed(tmp_path: Path) -> None:
    """Any byte of it: its rows are as they were, or its part is run again."""
    path, chance, refused = tmp_path / "rows", random.Random(3), 0
    RowStore(path).add({"a": [{"x": 0.5, "word": "one"}]})
    whole, rows = path.read_bytes(), RowStore(path).rows
    for _ in range(200):
        damaged = bytearray(whole)
        damaged[chance.randrange(len(whole))] ^= chance.randrange(1, 256)
        path.write_bytes(damaged)
        store = RowStore(path)
        assert store.rows == (rows if not store.damaged else {})
        refused += store.damaged > 0
    assert refused > 150


def test_heat_maps_and_tables_are_drawn(tmp_path: Path) -> None:
    rows = [{"x": x, "y": y, "v": x * y} for x in (1, 2) for y in (0.5, 1.0)]
    for axes in (("x", "y", ""), ("x", "", "y")):
        assert draw_heat_map(rows, axes, "v", "toy", tmp_path / "map.png").stat().st_size > 3000
    table = [{"case": "a", "method": name, "f": value, "f_se": 0.1} for name, value in (("one", 0.5), ("two", None))]
    (shown,) = draw_table(table, tmp_path, "toy", "case", [("f", "F")])
    assert shown.file.stat().st_size > 3000


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


def test_the_models_of_the_package_stay(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["first-stage", "--out", str(model_folders()["published"])]) == 2
    assert "--force" in capsys.readouterr().err


def test_superposed_sums_are_those_of_the_rendered_scene(bars: Bars) -> None:
    """At a phase and offset that were never filmed; after the filters have settled."""
    want = sums_of(three_bars(3.6, phase=77.0, blue_offset=33.0))[300:]
    stimuli = Stimuli(bars)
    got = stimuli.red(3.6) + stimuli.green([77.0], 3.6)[0] + stimuli.blue([33.0], 3.6)[0]
    error = (got[300:] - want).abs().amax(0) / want.amax()
    by_feature = (got[300:] - want).abs().amax(0) / want.amax(0)
    assert by_feature[[0, 1, 2]].max() < 0.015  # motion to the left, right and down
    assert error[3] < 1e-3  # nothing moves up
    assert by_feature[GROUPS["orientation"]].max() < 0.08  # orientation: filters of bars overlap
    assert by_feature[GROUPS["color"]].max() < 0.002


def test_films_repeat_with_the_period_of_the_shadow(bars: Bars) -> None:
    sums = bars.red.at(torch.tensor([10.0, 60.0]), 2.0)
    torch.testing.assert_close(sums[0], sums[1], rtol=1e-4, atol=1e-3)
    later = bars.blue.at(torch.tensor(0.0), 3.0)
    torch.testing.assert_close(later[:100], later[100:200], rtol=1e-3, atol=1e-2)
