"""Plots of training."""

from __future__ import annotations

from pathlib import Path

from ndtorch_train.plots import draw_heat_map, draw_table


def test_heat_maps_and_tables_are_drawn(tmp_path: Path) -> None:
    rows = [{"x": x, "y": y, "v": x * y} for x in (1, 2) for y in (0.5, 1.0)]
    for axes in (("x", "y", ""), ("x", "", "y")):
        assert draw_heat_map(rows, axes, "v", "toy", tmp_path / "map.png").stat().st_size > 3000
    table = [{"case": "a", "method": name, "f": value, "f_se": 0.1} for name, value in (("one", 0.5), ("two", None))]
    (shown,) = draw_table(table, tmp_path, "toy", "case", [("f", "F")])
    assert shown.file.stat().st_size > 3000
