"""Results as rows, and the rows as Markdown, CSV and a figure."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ndtorch_train.score.metrics import SceneScore, share


@dataclass(frozen=True)
class Row:
    """One method on one set of scenes at one moment.

    Attributes:
        test: the set: "random", a stress set, "two bars" or "three bars".
        method: name of the method; online: whether it saw the signals only once, in order.
        seconds: after the settling time.
        scores: one a scene.
        alternating: share of scenes whose outputs flip sign from step to step.
        right_from: median seconds from the first frame to the lasting right count; NaN if half never get there, None
            where it was not measured.
    """

    test: str
    method: str
    online: bool
    seconds: float
    scores: Sequence[SceneScore]
    alternating: float = 0.0
    right_from: float | None = None

    @property
    def count(self) -> tuple[float, float]:
        """Share of scenes counted right, and its standard error."""
        return share([s.counted for s in self.scores])

    @property
    def ok(self) -> tuple[float, float]:
        """Share of scenes that are ok, and its standard error."""
        return share([s.ok for s in self.scores])

    @property
    def f1(self) -> tuple[float, float]:
        """Mean F1 over scenes, and its standard error."""
        values = [s.f1 for s in self.scores]
        return float(np.mean(values)), float(np.std(values) / math.sqrt(max(1, len(values))))

    def count_of(self, bars: int) -> float:
        """Share counted right among scenes with that many bars."""
        return share([s.counted for s in self.scores if s.bars == bars])[0]


HEADER = "| method | online | seconds | count | 1 bar | 2 bars | 3 bars | F1 | ok | alternating | right from |"


def markdown(rows: Sequence[Row]) -> str:
    """The random scenes as one table, all other sets as another."""
    random = [row for row in rows if row.test == "random"]
    lines = [HEADER, "|" + "---|" * 11] if random else []
    for row in random:
        by_bars = " | ".join(number(row.count_of(n)) for n in (1, 2, 3))
        since = "-" if row.right_from is None else seconds(row.right_from)
        lines.append(
            f"| {row.method} | {'yes' if row.online else 'no'} | {row.seconds:g} | {spread(row.count)} | {by_bars} | "
            f"{spread(row.f1)} | {spread(row.ok)} | {number(row.alternating)} | {since} |"
        )
    text = "\n".join(lines) + "\n"
    others = [row for row in rows if row.test != "random"]
    if others:
        methods = list(dict.fromkeys(row.method for row in others))
        lines = [
            "",
            "| count right (and ok) | seconds | " + " | ".join(methods) + " |",
            "|" + "---|" * (2 + len(methods)),
        ]
        for test, moment in dict.fromkeys((row.test, row.seconds) for row in others):
            cells = []
            for name in methods:
                found = [row for row in others if (row.test, row.seconds, row.method) == (test, moment, name)]
                cells.append(cell(found[0]) if found else "-")
            lines.append(f"| {test} | {moment:g} | " + " | ".join(cells) + " |")
        text += "\n".join(lines) + "\n"
    return text


def cell(row: Row) -> str:
    """Share counted right and, where there is something to find, share ok; whole numbers for the papers' bars."""
    if row.test in ("two bars", "three bars"):
        counted, ok = (sum(values) for values in zip(*((s.counted, s.ok) for s in row.scores), strict=True))
        return f"{counted}/{len(row.scores)} ({ok})"
    if not any(s.bars for s in row.scores):
        return number(row.count[0])
    return f"{number(row.count[0])} ({number(row.ok[0])})"


def number(value: float) -> str:
    """Two decimals, a dash for nothing."""
    return "-" if math.isnan(value) else f"{value:.2f}"


def spread(value: tuple[float, float]) -> str:
    """A share and its standard error."""
    return f"{value[0]:.3f} ± {value[1]:.3f}"


def seconds(value: float) -> str:
    """Seconds, or what it means that there are none."""
    return "never" if math.isnan(value) else f"{value:.0f} s"


COLUMNS = [
    "test",
    "method",
    "online",
    "seconds",
    "scenes",
    "count",
    "count_se",
    "count_1",
    "count_2",
    "count_3",
    "f1",
    "f1_se",
    "ok",
    "ok_se",
    "alternating",
    "right_from",
]


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """All rows with all their numbers."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for row in rows:
            numbers = [*row.count, *(row.count_of(n) for n in (1, 2, 3)), *row.f1, *row.ok, row.alternating]
            cells = ["" if math.isnan(value) else f"{value:.4f}" for value in numbers]
            since = "" if row.right_from is None or math.isnan(row.right_from) else f"{row.right_from:g}"
            writer.writerow([row.test, row.method, row.online, row.seconds, len(row.scores), *cells, since])
