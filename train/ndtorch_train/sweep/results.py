"""Results of a sweep: one Parquet file, a table and heat maps."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ndtorch.utils.files import replacing, write_text
from ndtorch_train.plots import draw_heat_map, short
from ndtorch_train.rows import Row
from ndtorch_train.sweep.config import SweepConfig


def write_results(config: SweepConfig, rows: Sequence[Row], results: Sequence[str], folder: Path) -> None:
    """Write results.parquet (a row a trial), summary.md, and the heat maps as SVG and PNG."""
    import pyarrow
    import pyarrow.parquet

    with replacing(folder / "results.parquet") as beside:
        pyarrow.parquet.write_table(pyarrow.Table.from_pylist(list(rows)), beside)
    write_text(folder / "summary.md", summary(config, rows, results))
    for value in config.show[3] if rows else ():
        for kind in ("svg", "png"):
            draw_heat_map(list(rows), config.show[:3], value, config.name, folder / f"heatmap-{value}.{kind}")


def summary(config: SweepConfig, rows: Sequence[Row], results: Sequence[str]) -> str:
    """A Markdown table: means of every result for every value of every parameter that varies, of few values."""
    lines = [f"# {config.name}", "", f"{len(rows)} trials; means over all other parameters.", ""]
    lines += [f"| | | trials | {' | '.join(results)} |", f"|---|---|---|{'---|' * len(results)}"]
    for key in config.varied:
        values = sorted({row[key] for row in rows})
        if len(values) > 32:  # of a random sweep: by tenths
            edges = np.quantile([row[key] for row in rows], np.linspace(0, 1, 11))
            groups = [
                (f"{a:.3g}..{b:.3g}", [r for r in rows if a <= r[key] <= b]) for a, b in itertools.pairwise(edges)
            ]
        else:
            groups = [(short(value), [r for r in rows if r[key] == value]) for value in values]
        for name, group in groups:
            cells = []
            for result in results:
                known = [float(r[result]) for r in group if r[result] is not None]
                cells.append(f"{np.mean(known):.3g}" if known else "-")
            lines.append(f"| {key} | {name} | {len(group)} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
