"""The table of an evaluation: one row for all drives of a controller in an arena, under one disturbance."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any, NamedTuple

from ndtorch_robot.evaluation.drives import Summary

Drives = list[Summary]
Row = dict[str, Any]
"""Values of the columns by their keys; None where there is nothing to say."""


class Column(NamedTuple):
    """A column of the table.

    Attributes:
        key: of the value in a row; head: in the table.
        value: of all drives of the row.
        form: of the value, or of the parts of a tuple; a percent sign is left out, for the head has it.
        optional: whether the column is left out where no row has anything to show.
    """

    key: str
    head: str
    value: Callable[[Drives], Any]
    form: str = "{}"
    optional: bool = False

    def cell(self, row: Row) -> str:
        """The value as the table shows it; "" for nothing: None, or a tuple of nothing but zeros."""
        value = row[self.key]
        parts = value if isinstance(value, tuple) else (len(value),) if isinstance(value, list) else (value,)
        nothing = value is None or (isinstance(value, tuple) and not any(value))
        return "" if nothing else self.form.format(*parts).removesuffix("%")


def word(name: str) -> Callable[[Drives], str]:
    return lambda drives: str(drives[0].get(name, ""))


def total(drives: Drives, name: str) -> float:
    return float(sum(d.get(name, 0) for d in drives))


def hours(drives: Drives) -> float:
    return float(sum(d["simulated_seconds"] for d in drives)) / 3600


def hits_1000(drives: Drives) -> float | None:
    lengths = total(drives, "body_lengths")
    return 1000 * total(drives, "collisions") / lengths if lengths else None


def passed_close(drives: Drives) -> float | None:
    known = all("free_area_passed_40cm" in d for d in drives)
    return total(drives, "free_area_passed_40cm") / len(drives) if known else None


def of_maps(name: str) -> Callable[[Drives], float | None]:
    """The mean over the drives that have it."""

    def value(drives: Drives) -> float | None:
        values = [d["map"][name] for d in drives if d["map"][name] is not None]
        return sum(values) / len(values) if values else None

    return value


def pose_errors(name: str, factor: float = 1.0) -> Callable[[Drives], tuple[float, float] | None]:
    """The median over the drives of an error of the corrected pose, and the largest; None without an error."""

    def value(drives: Drives) -> tuple[float, float] | None:
        errors = [d.get("pose_error", {}) for d in drives]
        values = [factor * error["located"][name] for error in errors if "located" in error]
        return (median(values), max(values)) if any(values) else None

    return value


COLUMNS = (
    Column("arena", "arena", word("arena")),
    Column("walls", "walls", word("walls")),
    Column("controller", "controller", word("controller")),
    Column("disturbance", "disturbance", word("disturbance"), optional=True),
    Column("drives", "drives", lambda d: d),
    Column("hours", "simulated hours", hours, "{:.2f}"),
    Column("collisions_h", "collisions/h", lambda d: total(d, "collisions") / hours(d), "{:.1f}"),
    Column("places_hit", "places hit", lambda d: round(total(d, "collision_places"))),
    Column(
        "people", "people hit / hit standing",
        lambda d: (round(total(d, "people_hit")), round(total(d, "hit_while_standing"))), "{} / {}", True,
    ),
    Column("stops_h", "stops/h", lambda d: total(d, "stopped") / hours(d), "{:.1f}"),
    Column("distance_m", "m driven", lambda d: total(d, "distance_m"), "{:.0f}"),
    Column("hits_1000", "collisions/1000 body lengths", hits_1000, "{:.2f}", True),
    Column("passed", "passed within 1 m %", lambda d: total(d, "free_area_passed") / len(d), "{:.0%}"),
    Column("passed_close", "passed within 0.4 m %", passed_close, "{:.0%}"),
    Column("precision", "map precision %", of_maps("precision"), "{:.0%}"),
    Column("surfaces", "map within 10 cm of surfaces %", of_maps("surfaces"), "{:.0%}"),
    Column("recall", "map recall %", of_maps("recall"), "{:.0%}"),
    Column("position_cm", "map position error cm", of_maps("position_error_cm"), "{:.1f}"),
    Column("spacing_percent", "map spacing error %", of_maps("spacing_error_percent"), "{:.2f}"),
    Column("pose_cm", "pose error cm, worst drive", pose_errors("median_m", 100), "{:.1f}, {:.1f}", True),
    Column("pose_degrees", "pose error degrees, worst drive", pose_errors("median_degrees"), "{:.2f}, {:.2f}", True),
)  # fmt: skip
"""All columns, in order. The first four are words, and name the row."""

WORDS = COLUMNS[:4]


def rows_of(summaries: list[Summary]) -> list[Row]:
    groups: dict[tuple[str, ...], Drives] = {}
    for summary in summaries:
        groups.setdefault(tuple(column.value([summary]) for column in WORDS), []).append(summary)
    return [{column.key: column.value(drives) for column in COLUMNS} for drives in groups.values()]


def shown_cells(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Titles and cells of the columns to show: not the optional ones in which no row has anything."""
    kept = [column for column in COLUMNS if not column.optional or any(column.cell(row) for row in rows)]
    return [column.head for column in kept], [[column.cell(row) for column in kept] for row in rows]


def markdown(rows: Sequence[Row], note: str) -> str:
    """The table in Markdown, with a line below it that says how it was made."""
    names, cells = shown_cells(rows)
    words = sum(column.head in names for column in WORDS)
    lines = ["| " + " | ".join(names) + " |", "|---" * words + "|---:" * (len(names) - words) + "|"]
    lines += ["| " + " | ".join(cell or "-" for cell in row) + " |" for row in cells]
    return "\n".join([*lines, "", note, ""])


def comma_separated(rows: Sequence[Row]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([column.head for column in COLUMNS])
    writer.writerows([column.cell(row) for column in COLUMNS] for row in rows)
    return out.getvalue()
