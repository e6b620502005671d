"""Results of a sweep: kept part by part while it runs, one Parquet file, a table and heat maps at the end."""

from __future__ import annotations

import hashlib
import itertools
import json
import secrets
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ndtorch.errors import InputError
from ndtorch.files import replacing
from ndtorch_train.sweep.config import SweepConfig
from ndtorch_train.sweep.parameters import Trial, trial_id

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = dict[str, Any]

CHECKSUM = b"ndtorch checksum"


class ResultStore:
    """Rows of finished trials in a folder: `results.parquet`, and `parts/` while a sweep runs.

    Every row holds the trial's parameters, its results, its name (`trial`), and the fingerprint of the code (`code`).

    Args:
        folder: made if missing.
        code: rows of other code do not count.
    """

    def __init__(self, folder: Path, code: str) -> None:
        self.folder, self.code = folder, code
        self.parts = folder / "parts"
        self.parts.mkdir(parents=True, exist_ok=True)
        self.outdated = 0
        self.damaged: list[str] = []

    def load(self) -> dict[str, Row]:
        """Finished trials by name; `outdated` counts those of other code, `damaged` says which files cannot be used."""
        found: dict[str, Row] = {}
        self.outdated, self.damaged = 0, []
        for path in [self.folder / "results.parquet", *sorted(self.parts.glob("*.parquet"))]:
            try:
                rows = read(path)
            except InputError as error:
                self.damaged.append(str(error))
                continue
            for row in rows:
                if row.get("code") == self.code:
                    found[row["trial"]] = row
                else:
                    self.outdated += 1
        return found

    def add(self, trials: Sequence[Trial], results: Sequence[Mapping[str, Any]]) -> None:
        """Keep the results of some trials."""
        rows = [
            {"trial": trial_id(trial), **trial, **result, "code": self.code}
            for trial, result in zip(trials, results, strict=True)
        ]
        # Named at random: processes of two containers, or of two machines, may have the same number.
        write(self.parts / f"{secrets.token_hex(8)}.parquet", rows)

    def finish(self, config: SweepConfig) -> list[Row]:
        """Write `results.parquet` with the trials of this sweep, and drop the parts; returns the rows."""
        parts = list(self.parts.glob("*.parquet"))  # before they are read: a part that comes later stays
        found = self.load()
        rows = [found[name] for name in map(trial_id, config.trials) if name in found]
        write(self.folder / "results.parquet", rows)
        for part in parts:
            part.unlink(missing_ok=True)
        return rows


def read(path: Path) -> list[Row]:
    """Rows of a Parquet file that `write` wrote; none where it is missing.

    Raises:
        InputError: it was cut off, or damaged, or has no checksum.
    """
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.read_table(path)
        rows: list[Row] = table.to_pylist()
    except FileNotFoundError:
        return []
    except (OSError, pyarrow.ArrowException, ValueError, MemoryError, OverflowError) as error:
        raise InputError(f"{path} is damaged: {str(error).splitlines()[0]}") from None
    given = (table.schema.metadata or {}).get(CHECKSUM, b"").decode("ascii", "replace")
    if given != checksum(rows):
        raise InputError(f"{path} is damaged: its checksum does not fit" if given else f"{path} has no checksum")
    return rows


def write(path: Path, rows: Sequence[Row]) -> None:
    """Write a Parquet file at once, with a checksum: whoever is killed leaves the old one."""
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.Table.from_pylist(list(rows))
    # Of the rows as they are read: columns that some rows lack are filled, and numbers have the types of the table.
    table = table.replace_schema_metadata({CHECKSUM: checksum(table.to_pylist()).encode()})
    with replacing(path) as beside:
        pyarrow.parquet.write_table(table, beside)


def checksum(rows: Sequence[Row]) -> str:
    """SHA-256 over names and values."""
    return hashlib.sha256(json.dumps(rows, sort_keys=True, default=repr).encode()).hexdigest()


def means(rows: Sequence[Row], keys: Sequence[str], value: str) -> dict[tuple[Any, ...], tuple[float, int]]:
    """Mean of a result and number of trials for every combination of the values of `keys`."""
    groups: dict[tuple[Any, ...], list[float]] = {}
    for row in rows:
        if row[value] is not None:
            groups.setdefault(tuple(row[key] for key in keys), []).append(float(row[value]))
    return {key: (float(np.mean(values)), len(values)) for key, values in groups.items()}


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
            groups = [(shown(value), [r for r in rows if r[key] == value]) for value in values]
        for name, group in groups:
            cells = []
            for result in results:
                known = [float(r[result]) for r in group if r[result] is not None]
                cells.append(f"{np.mean(known):.3g}" if known else "-")
            lines.append(f"| {key} | {name} | {len(group)} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def shown(value: Any) -> str:
    """A parameter's value in few characters."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def heat_map(config: SweepConfig, rows: Sequence[Row], value: str) -> Figure:
    """Means of a result over two parameters, a panel for every value of a third.

    Values of a random sweep are put into twelve bins.
    """
    import matplotlib
    from matplotlib.figure import Figure

    colors = matplotlib.colormaps["cividis"].with_extremes(bad="0.9")
    x, y, by, _ = config.show
    panels = sorted({row[by] for row in rows}) if by else [None]
    panels = panels[:6]
    figure = Figure((1.2 + 5.2 * len(panels), 4.6), layout="constrained")
    axes = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    columns, column_of = binned([row[x] for row in rows])
    lines, line_of = binned([row[y] for row in rows]) if y else ([""], lambda _: 0)
    numbers = [float(row[value]) for row in rows if row[value] is not None]
    low, high = (min(numbers), max(numbers)) if numbers else (0.0, 1.0)
    if low >= 0 and high <= 1:
        low, high = 0.0, 1.0
    picture = None
    for one, panel in zip(axes, panels, strict=True):
        total, count = np.zeros((len(lines), len(columns))), np.zeros((len(lines), len(columns)))
        for row in rows:
            if (not by or row[by] == panel) and row[value] is not None:
                at = line_of(row[y]) if y else 0, column_of(row[x])
                total[at] += float(row[value])
                count[at] += 1
        image = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        picture = one.imshow(image, origin="lower", aspect="auto", cmap=colors, vmin=low, vmax=high)
        ticks(one.xaxis, columns)
        ticks(one.yaxis, lines)
        one.set(xlabel=with_unit(x), title=f"{by} {shown(panel)}" if by else value)
    axes[0].set_ylabel(with_unit(y))
    if picture is not None:
        figure.colorbar(picture, ax=list(axes), label=value)
    figure.suptitle(f"{config.name}: mean {value} of {len(rows)} trials", fontsize=11)
    return figure


UNITS = {
    "phase": "degrees",
    "offset": "px",
    "gamma": "1/s",
    "tau_in": "s",
    "tau_out": "s",
    "tau_onset": "s",
    "window": "s",
    "seconds": "s",
    "reach": "m",
    "min_disparity": "px",
    "max_disparity": "px",
    "features": "a frame",
}


def with_unit(name: str) -> str:
    """A parameter with its unit."""
    return f"{name} ({UNITS[name]})" if name in UNITS else name


def binned(values: Sequence[Any]) -> tuple[list[str], Any]:
    """Labels of places along an axis and the place of a value."""
    unique = sorted(set(values))
    if len(unique) <= 40:
        return [shown(value) for value in unique], {value: k for k, value in enumerate(unique)}.__getitem__
    edges = np.quantile(values, np.linspace(0, 1, 13))
    labels = [f"{a:.3g}" for a in edges[:-1]]
    return labels, lambda value: int(np.clip(np.searchsorted(edges, value, side="right") - 1, 0, 11))


def ticks(axis: Any, labels: Sequence[str]) -> None:
    """At most a dozen labels."""
    step = max(1, -(-len(labels) // 12))
    axis.set_ticks(range(0, len(labels), step), labels[::step])


def draw(config: SweepConfig, rows: Sequence[Row], folder: Path) -> list[str]:
    """Write the heat maps as SVG and PNG; returns their names."""
    names = []
    for value in config.show[3]:
        figure = heat_map(config, rows, value)
        for kind in ("svg", "png"):
            with replacing(folder / f"heatmap-{value}.{kind}") as beside:
                figure.savefig(beside, format=kind, dpi=110)
        names.append(f"heatmap-{value}.png")
    return names
