"""The table of an evaluation: one row for all drives of a controller in an arena."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from statistics import median
from typing import NamedTuple

from ndtorch_robot.evaluation.drives import Summary


class Row(NamedTuple):
    """All drives of one controller in one arena, under one disturbance.

    Attributes:
        hours, collisions_h, stops_h, distance_m: of all drives together.
        hits_1000: collisions in a thousand lengths of the body that were driven, of all drives together.
        passed, passed_close: share of the free area passed within 1 m and 0.4 m, mean over the drives.
        places_hit: where there was a collision, of all drives together.
        people: people hit from ahead, and times the car was hit while stationary, of all drives together.
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
    hits_1000: float | None
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


def text(value: float | None, digits: int, factor: float = 1.0) -> str:
    """A number with so many digits; "" for None."""
    return "" if value is None else f"{factor * value:.{digits}f}"


class Column(NamedTuple):
    """A column: how a row is written in it, "" where there is nothing; and whether it may be left out then."""

    cell: Callable[[Row], str]
    optional: bool = False


COLUMNS: dict[str, Column] = {
    "arena": Column(lambda r: r.arena),
    "walls": Column(lambda r: r.walls),
    "controller": Column(lambda r: r.controller),
    "disturbance": Column(lambda r: r.disturbance, optional=True),
    "drives": Column(lambda r: str(len(r.drives))),
    "simulated hours": Column(lambda r: text(r.hours, 2)),
    "collisions/h": Column(lambda r: text(r.collisions_h, 1)),
    "places hit": Column(lambda r: str(r.places_hit)),
    "people hit / hit standing": Column(lambda r: "{} / {}".format(*r.people) if any(r.people) else "", optional=True),
    "stops/h": Column(lambda r: text(r.stops_h, 1)),
    "m driven": Column(lambda r: text(r.distance_m, 0)),
    "collisions/1000 body lengths": Column(lambda r: text(r.hits_1000, 2), optional=True),
    "passed within 1 m %": Column(lambda r: text(r.passed, 0, 100)),
    "passed within 0.4 m %": Column(lambda r: text(r.passed_close, 0, 100)),
    "gates passed": Column(lambda r: "{} of {}".format(*r.gates) if r.gates[1] else "", optional=True),
    "map precision %": Column(lambda r: text(r.precision, 0, 100)),
    "map within 10 cm of surfaces %": Column(lambda r: text(r.surfaces, 0, 100)),
    "map recall %": Column(lambda r: text(r.recall, 0, 100)),
    "map position error cm": Column(lambda r: text(r.position_cm, 1)),
    "map spacing error %": Column(lambda r: text(r.spacing_percent, 2)),
    "pose error cm, worst drive": Column(lambda r: "{:.1f}, {:.1f}".format(*r.pose_cm) if r.pose_cm else "", True),
    "pose error degrees, worst drive": Column(
        lambda r: "{:.2f}, {:.2f}".format(*r.pose_degrees) if r.pose_degrees else "", True
    ),
}
"""All columns, in order. The first four are words."""

WORDS = 4


def rows_of(summaries: list[Summary]) -> list[Row]:
    groups: dict[tuple[str, str, str, str], list[Summary]] = {}
    for summary in summaries:
        arena, walls, controller = (str(summary[name]) for name in ("arena", "walls", "controller"))
        key = (arena, walls, controller, str(summary.get("disturbance", "")))
        groups.setdefault(key, []).append(summary)
    return [row_of(key, drives) for key, drives in groups.items()]


def row_of(key: tuple[str, str, str, str], drives: list[Summary]) -> Row:
    hours = sum(d["simulated_seconds"] for d in drives) / 3600

    def total(name: str) -> float:
        return float(sum(d.get(name, 0) for d in drives))

    def of_maps(name: str) -> float | None:
        values = [d["map"][name] for d in drives if d["map"][name] is not None]
        return sum(values) / len(values) if values else None

    gates = [d["gates"] for d in drives if "gates" in d]
    lengths = sum(d.get("body_lengths", 0.0) for d in drives)
    return Row(
        *key,
        drives,
        hours,
        total("collisions") / hours,
        total("stopped") / hours,
        total("distance_m"),
        1000 * total("collisions") / lengths if lengths else None,
        total("free_area_passed") / len(drives),
        total("free_area_passed_40cm") / len(drives) if all("free_area_passed_40cm" in d for d in drives) else None,
        round(total("collision_places")),
        (round(total("people_hit")), round(total("hit_while_standing"))),
        (sum(pair[0] for pair in gates), sum(pair[1] for pair in gates)),
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
    errors = [d.get("pose_error", {}) for d in drives]
    values = [factor * error["located"][name] for error in errors if "located" in error]
    return (median(values), max(values)) if any(values) else None


def shown_cells(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Titles and cells of the columns to show: not the optional ones in which no row has anything."""
    kept = {name: c for name, c in COLUMNS.items() if not c.optional or any(c.cell(row) for row in rows)}
    return list(kept), [[column.cell(row) for column in kept.values()] for row in rows]


def markdown(rows: Sequence[Row], note: str) -> str:
    """The table in Markdown, with a line below it that says how it was made."""
    names, cells = shown_cells(rows)
    words = sum(name in names for name in list(COLUMNS)[:WORDS])
    lines = ["| " + " | ".join(names) + " |", "|---" * words + "|---:" * (len(names) - words) + "|"]
    lines += ["| " + " | ".join(cell or "-" for cell in row) + " |" for row in cells]
    return "\n".join([*lines, "", note, ""])


def comma_separated(rows: Sequence[Row]) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([column.cell(row) for column in COLUMNS.values()] for row in rows)
    return out.getvalue()
