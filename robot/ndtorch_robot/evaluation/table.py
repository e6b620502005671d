"""The table of an evaluation: drives put together by arena, walls and controller."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

from ndtorch_robot.evaluation.drives import Summary


class Row(NamedTuple):
    """All drives of one controller in one arena, under one disturbance.

    Attributes:
        hours, collisions_h, stops_h, distance_m: of all drives together.
        passed, passed_close: share of the free area passed within 1 m and 0.4 m, mean over the drives.
        places_hit: where there was a collision, of all drives together.
        people: people hit from ahead; times the car was hit while it stood, of all drives together.
        gates: doors, lines and the like that were passed, and how many there were.
        precision, surfaces, recall, position_cm, spacing_percent: of the maps, means over the drives that have them.
        pose_cm, pose_degrees: median error of the corrected pose in a drive: the median over the drives, and the worst;
            None where there was no error, or it is not known.
        drives: the summaries.
    """

    arena: str
    walls: str
    controller: str
    disturbance: str
    drives: list[Summary]
    hours: float
    collisions_h: float
    stops_h: float
    distance_m: float
    passed: float
    passed_close: float | None
    places_hit: int
    people: tuple[int, int]
    gates: tuple[int, int]
    precision: float | None
    surfaces: float | None
    recall: float | None
    position_cm: float | None
    spacing_percent: float | None
    pose_cm: tuple[float, float] | None
    pose_degrees: tuple[float, float] | None


COLUMNS = (
    "arena",
    "walls",
    "controller",
    "disturbance",
    "drives",
    "simulated hours",
    "collisions/h",
    "places hit",
    "people hit / hit standing",
    "stops/h",
    "m driven",
    "passed within 1 m %",
    "passed within 0.4 m %",
    "gates passed",
    "map precision %",
    "map within 10 cm of surfaces %",
    "map recall %",
    "map position error cm",
    "map spacing error %",
    "pose error cm, worst drive",
    "pose error degrees, worst drive",
)


WORDS = 3
"""Columns of words, that come first."""

SELDOM = ("disturbance", "people hit / hit standing", "gates passed", *COLUMNS[-2:])
"""Columns that are left out where nobody has anything in them."""


def rows_of(summaries: list[Summary]) -> list[Row]:
    """Put drives together, in the order in which they come."""
    groups: dict[tuple[str, str, str, str], list[Summary]] = {}
    for summary in summaries:
        arena, walls, controller = (str(summary[name]) for name in ("arena", "walls", "controller"))
        key = (arena, walls, controller, str(summary.get("disturbance", "")))
        groups.setdefault(key, []).append(summary)
    return [row_of(key, drives) for key, drives in groups.items()]


def row_of(key: tuple[str, str, str, str], drives: list[Summary]) -> Row:
    """One row of the table."""
    hours = sum(number(d["simulated_seconds"]) for d in drives) / 3600

    def total(name: str) -> float:
        return sum(number(d[name]) for d in drives)

    def count(name: str) -> float:
        return sum(number(d.get(name, 0)) for d in drives)

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
        total("free_area_passed_40cm") / len(drives) if all("free_area_passed_40cm" in d for d in drives) else None,
        round(count("collision_places")),
        (round(count("people_hit")), round(count("hit_while_standing"))),
        gates_of(drives),
        of_maps("precision"),
        of_maps("surfaces"),
        of_maps("recall"),
        of_maps("position_error_cm"),
        of_maps("spacing_error_percent"),
        pose_errors(drives, "median_m", 100.0),
        pose_errors(drives, "median_degrees", 1.0),
    )


def pose_errors(drives: list[Summary], name: str, factor: float) -> tuple[float, float] | None:
    """The median over the drives of an error of the corrected pose, and the largest."""
    errors = [d["pose_error"] for d in drives if isinstance(d.get("pose_error"), dict)]
    values = [factor * number(e["located"][name]) for e in errors if isinstance(e, dict) and "located" in e]
    return (median(values), max(values)) if any(values) else None


def gates_of(drives: list[Summary]) -> tuple[int, int]:
    """How many gates were passed in all drives together, and how many there were."""
    pairs = [pair for d in drives if isinstance(pair := d.get("gates"), list)]
    return sum(pair[0] for pair in pairs), sum(pair[1] for pair in pairs)


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
        row.disturbance,
        str(len(row.drives)),
        value(row.hours, 2),
        value(row.collisions_h, 1),
        str(row.places_hit),
        "{} / {}".format(*row.people) if any(row.people) else "",
        value(row.stops_h, 1),
        value(row.distance_m, 0),
        value(row.passed, 0, 100),
        value(row.passed_close, 0, 100),
        "{} of {}".format(*row.gates) if row.gates[1] else "",
        value(row.precision, 0, 100),
        value(row.surfaces, 0, 100),
        value(row.recall, 0, 100),
        value(row.position_cm, 1),
        value(row.spacing_percent, 2),
        "{:.1f}, {:.1f}".format(*row.pose_cm) if row.pose_cm else "",
        "{:.2f}, {:.2f}".format(*row.pose_degrees) if row.pose_degrees else "",
    ]


def columns_of(rows: Sequence[Row]) -> list[int]:
    """Numbers of the columns to show: not those of `SELDOM` in which no row has anything."""
    filled = [cells(row) for row in rows]
    return [k for k, name in enumerate(COLUMNS) if name not in SELDOM or any(row[k] for row in filled)]


def markdown(rows: list[Row], note: str) -> str:
    """The table in Markdown, with a line below it that says how it was made."""
    kept = columns_of(rows)
    lines = ["| " + " | ".join(COLUMNS[k] for k in kept) + " |", "|---" * WORDS + "|---:" * (len(kept) - WORDS) + "|"]
    lines += ["| " + " | ".join(cells(row)[k] or "-" for k in kept) + " |" for row in rows]
    return "\n".join([*lines, "", note, ""])


def comma_separated(rows: list[Row]) -> str:
    """The table as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(cells(row) for row in rows)
    return text.getvalue()
