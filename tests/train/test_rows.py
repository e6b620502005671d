"""Rows that are kept while a command runs, and the plots of them."""

from __future__ import annotations

import random
from pathlib import Path

from ndtorch_train.plots import draw_heat_map, draw_table
from ndtorch_train.rows import RowStore


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
