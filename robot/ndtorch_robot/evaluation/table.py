"""The table of an evaluation: drives put together by arena, walls and controller."""

from __future__ import annotations

import csv
import io
from typing import NamedTuple

from ndtorch_robot.evaluation.drives import Summary


class Row(NamedTuple):
    """All drives of one controller in one arena.

    Attributes:
        hours, collisions_h, stops_h, distance_m: of all drives together.
        passed: share of the free area passed, mean over the drives.
        precision, recall, position_cm, spacing_percent: of the maps, means over the drives that have them.
        drives: the summaries.
    """

    arena: str
    walls: str
    controller: str
    drives: list[Summary]
    hours: float
    collisions_h: float
    stops_h: float
    distance_m: float
    passed: float
    precision: float | None
    recall: float | None
    position_cm: float | None
    spacing_percent: float | None


COLUMNS = (
    "arena",
    "walls",
    "controller",
    "drives",
    "simulated hours",
    "collisions/h",
    "stops/h",
    "m driven",
    "free area passed %",
    "map precision %",
    "map recall %",
    "map position error cm",
    "map spacing error %",
)


def rows_of(summaries: list[Summary]) -> list[Row]:
    """Put drives together, in the order in which they come."""
    groups: dict[tuple[str, str, str], list[Summary]] = {}
    for summary in summaries:
        key = (str(summary["arena"]), str(summary["walls"]), str(summary["controller"]))
        groups.setdefault(key, []).append(summary)
    return [row_of(key, drives) for key, drives in groups.items()]


def row_of(key: tuple[str, str, str], drives: list[Summary]) -> Row:
    """One row of the table."""
    hours = sum(number(d["simulated_seconds"]) for d in drives) / 3600

    def total(name: str) -> float:
        return sum(number(d[name]) for d in drives)

    def of_maps(name: str) -> float | None:
        values = [m[name] for d in drives if isinstance(m := d["map"], dict) and m[name] is not None]
        return sum(values) / len(values) if values else None

    return Row(
        *key,
        drives,
        hours,
        total("collisions") / hours,
        total("stopped") / hours,
        total("distance_m"),
        total("free_area_passed") / len(drives),
        of_maps("precision"),
        of_maps("recall"),
        of_maps("position_error_cm"),
        of_maps("spacing_error_percent"),
    )


def number(value: object) -> float:
    """A number of a summary."""
    assert isinstance(value, int | float)
    return float(value)


def cells(row: Row) -> list[str]:
    """A row as text, in the order of `COLUMNS`; "" where there is nothing to measure."""

    def value(x: float | None, digits: int, factor: float = 1.0) -> str:
        return "" if x is None else f"{factor * x:.{digits}f}"

    return [
        row.arena,
        row.walls,
        row.controller,
        str(len(row.drives)),
        value(row.hours, 2),
        value(row.collisions_h, 1),
        value(row.stops_h, 1),
        value(row.distance_m, 0),
        value(row.passed, 0, 100),
        value(row.precision, 0, 100),
        value(row.recall, 0, 100),
        value(row.position_cm, 1),
        value(row.spacing_percent, 2),
    ]


def markdown(rows: list[Row], note: str) -> str:
    """The table in Markdown, with a line below it that says how it was made."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|---|---|---" + "|---:" * (len(COLUMNS) - 3) + "|"]
    lines += ["| " + " | ".join(c or "-" for c in cells(row)) + " |" for row in rows]
    return "\n".join([*lines, "", note, ""])


def comma_separated(rows: list[Row]) -> str:
    """The table as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(cells(row) for row in rows)
    return text.getvalue()
