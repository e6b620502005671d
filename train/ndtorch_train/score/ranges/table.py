"""Shares of right ranges: a row a pair, a condition and a method, and means over pairs."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from ndtorch_train.score.ranges.methods import Found
from ndtorch_train.score.ranges.pairs import Disparity

HEADS = ("pair", "condition", "method", "a row", "with truth", "1 px", "2 px", "10 %", "ms", "of SGBM's time")


@dataclass(frozen=True)
class Row:
    """Scores of a method on a pair.

    Attributes:
        pair, number, condition, method: what was scored.
        per_row: ranges in a row and frame.
        known_per_row: those of them whose truth is known; only these count in what follows.
        within_1, within_2: shares whose disparity is right to 1 and to 2 pixels.
        within_10: share whose range is right to 10 %.
        ms: processor time of one row, of SGBM of the whole picture.
        of_sgbm: the same over SGBM's in the same process.
    """

    pair: str
    number: int
    condition: str
    method: str
    per_row: float
    known_per_row: float
    within_1: float
    within_2: float
    within_10: float
    ms: float
    of_sgbm: float

    def cells(self) -> list[str]:
        """As the table shows it."""
        shares = [
            "-" if np.isnan(v) else f"{v:.3f}".removeprefix("0") for v in (self.within_1, self.within_2, self.within_10)
        ]
        counts = [f"{self.per_row:.1f}", f"{self.known_per_row:.1f}"]
        times = [f"{self.ms:.2f}", "1" if self.of_sgbm == 1 else f"1/{1 / max(self.of_sgbm, 1e-9):.0f}"]
        return [self.pair, self.condition, self.method, *counts, *shares, *times]


def judge(found: Found, truth: Disparity) -> tuple[float, float, float, float, float]:
    """Ranges a row, those with truth, and the shares within 1 px, 2 px and 10 %."""
    true = truth[found.row, found.column].astype(np.float64)
    known = true > 0
    said, true = found.disparity[known], true[known]
    counts = len(found.row) / max(found.rows, 1), len(true) / max(found.rows, 1)
    if not len(true):
        return (*counts, np.nan, np.nan, np.nan)
    off, far = np.abs(said - true), np.abs(true / said - 1)
    return (*counts, float(np.mean(off <= 1)), float(np.mean(off <= 2)), float(np.mean(far <= 0.1)))


def means(rows: Sequence[Row]) -> Iterable[Row]:
    """Over all pairs of even number, over all of odd number, and over all, every pair alike."""
    for name, chosen in (("even pairs", {0}), ("odd pairs", {1}), ("all pairs", {0, 1})):
        for condition, method in dict.fromkeys((row.condition, row.method) for row in rows):
            mine = [r for r in rows if (r.condition, r.method) == (condition, method) and r.number % 2 in chosen]
            if len({row.number for row in mine}) > 1 or (mine and name == "all pairs"):
                values = [[getattr(row, field.name) for row in mine] for field in fields(Row)[4:]]
                yield Row(name, -1, condition, method, *(mean(value) for value in values))


def mean(values: Sequence[float]) -> float:
    """The mean of those that are numbers."""
    real = [value for value in values if not np.isnan(value)]
    return float(np.mean(real)) if real else float("nan")


def markdown(rows: Sequence[Row]) -> str:
    """The table."""
    lines = ["| " + " | ".join(HEADS) + " |", "|" + "---|" * len(HEADS)]
    return "\n".join([*lines, *("| " + " | ".join(row.cells()) + " |" for row in rows)]) + "\n"


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """ranges.csv: one line a pair, a condition and a method."""
    names = [field.name for field in fields(Row)]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for row in rows:
            values = [getattr(row, name) for name in names]
            writer.writerow([f"{v:.6g}" if isinstance(v, float) else v for v in values])
