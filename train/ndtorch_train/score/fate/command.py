"""`ndtorch score --common-fate N`: who finds patches of dots that only their motion shows."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2

from ndtorch.files import write_text
from ndtorch.report.page import Shown
from ndtorch_train.score.choices import Split
from ndtorch_train.score.fate.methods import METHODS
from ndtorch_train.score.fate.scoring import Condition, FateRow, conditions, fate_rows, wanted_methods
from ndtorch_train.score.figure import COLORS
from ndtorch_train.score.report import read_rows, write_score_page

WHAT = ("count", "place", "iou")
NAME = "common-fate"


class FateComparison:
    """Score methods on random dots; call it with a folder for common-fate.csv, .md, .png and report.html.

    Args:
        methods: names among `METHODS`; none for all.
        split: which seeds.
        scenes: of every condition.
        told: is told how far it is.
        asked: the conditions; all of them otherwise.

    Raises:
        InputError: an unknown method.
    """

    def __init__(
        self,
        methods: Sequence[str],
        split: Split,
        scenes: int,
        told: Callable[[str], None],
        asked: Sequence[Condition] | None = None,
    ) -> None:
        self.methods = wanted_methods(methods or list(METHODS))
        self.split, self.scenes, self.told, self.asked = split, scenes, told, asked

    def __call__(self, out: Path) -> tuple[list[dict[str, Any]], str]:
        """Write the table after every condition; returns its rows, and the words to print."""
        cv2.setNumThreads(1)
        rows, text = list[FateRow](), ""
        asked = conditions() if self.asked is None else self.asked
        for condition in asked:
            rows += fate_rows(self.methods, self.split, self.scenes, [condition], self.told)
            text = self.write(rows, out)
        return read_rows(out / f"{NAME}.csv"), text

    def write(self, rows: Sequence[FateRow], out: Path) -> str:
        """All files, of the rows so far."""
        text = (
            f"Split {self.split}, {self.scenes} scenes a row, seen at three moments of the last second. Count right, F "
            f"of places, mean intersection over union.\n\n{markdown(rows)}"
        )
        with (out / f"{NAME}.csv").open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["condition", "value", "method", *(f"{w}{s}" for w in WHAT for s in ("", "_se"))])
            for row in rows:
                cells = [f"{v:.4f}" for what in WHAT for v in (row.mean(what), row.error(what))]
                writer.writerow([row.condition.name, f"{row.condition.value:g}", row.method, *cells])
        write_text(out / f"{NAME}.md", text)
        picture = draw(rows, out / f"{NAME}.png")
        shown = [Shown(picture, "The same as a picture", "Lines: mean over scenes. Bars: two standard errors.")]
        write_score_page("Random dots by common fate", text, shown, out)
        return text


def markdown(rows: Sequence[FateRow]) -> str:
    """A row a condition, a column a method: count, place, IoU."""
    methods = list(dict.fromkeys(row.method for row in rows))
    lines = ["| count, place, IoU | " + " | ".join(methods) + " |", "|" + "---|" * (1 + len(methods))]
    for condition in dict.fromkeys((row.condition.name, row.condition.value) for row in rows):
        cells = []
        for name in methods:
            (row,) = (r for r in rows if (r.condition.name, r.condition.value) == condition and r.method == name)
            values = [row.mean(what) for what in WHAT]
            cells.append(", ".join("-" if v != v else f"{v:.2f}" for v in values))
        lines.append(f"| {condition[0]} {condition[1]:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def draw(rows: Sequence[FateRow], path: Path) -> Path:
    """Count, place and IoU against coherence, and against every other parameter."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys(row.condition.name for row in rows))
    methods = list(dict.fromkeys(row.method for row in rows))
    figure = Figure(figsize=(2.6 + 2.6 * len(names), 7.5), dpi=110, layout="constrained")
    panels = figure.subplots(3, len(names), squeeze=False, sharey=True, sharex="col")
    for column, name in enumerate(names):
        values = sorted({row.condition.value for row in rows if row.condition.name == name})
        for line, what in enumerate(WHAT):
            axes = panels[line, column]
            for n, method in enumerate(methods):
                mine = {r.condition.value: r for r in rows if r.condition.name == name and r.method == method}
                means, errors = ([getattr(mine[v], f)(what) for v in values] for f in ("mean", "error"))
                style = {"lw": 2.5, "zorder": 5} if n == 0 else {"lw": 1.2}
                axes.errorbar(
                    range(len(values)), means, [2 * e for e in errors], marker="o", ms=4, capsize=2,
                    color=COLORS[n % len(COLORS)], label=method, **style,
                )  # fmt: skip
            axes.set_ylim(-0.05, 1.05)
            axes.grid(axis="y", color="0.9")
            axes.set_xticks(range(len(values)), [f"{v:g}" for v in values])
            if column == 0:
                axes.set_ylabel({"count": "count right", "place": "F of places", "iou": "IoU"}[what])
        panels[2, column].set_xlabel(
            {"density": "dots a pixel", "lifetime": "lifetime, s", "ground": "coherence of the ground"}.get(name, name)
        )
    panels[0, 0].legend(fontsize=7, loc="upper left")
    figure.savefig(path)
    return path
