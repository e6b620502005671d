"""The table of an evaluation: one row for all drives of a controller in an arena, under one disturbance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from statistics import mean, median
from typing import Any

Drives = list[dict[str, Any]]
Row = dict[str, Any]
"""Values of the columns by their keys; None where there is nothing to say. `drives` are the summaries."""

WORDS = ("arena", "walls", "controller", "disturbance")
"""Keys that name a row."""


def total(drives: Drives, key: str) -> float:
    return float(sum(drive.get(key, 0) for drive in drives))


def of_maps(key: str) -> Callable[[Drives], float | None]:
    """The mean over the drives that have it."""

    def value(drives: Drives) -> float | None:
        values = [drive["map"][key] for drive in drives if drive["map"][key] is not None]
        return mean(values) if values else None

    return value


def of_poses(key: str, factor: float = 1.0) -> Callable[[Drives], float | None]:
    """The median over the drives of an error of the corrected pose; None without an error."""

    def value(drives: Drives) -> float | None:
        values = [factor * drive["pose_error"]["located"][key] for drive in drives if drive.get("pose_error")]
        return median(values) if any(values) else None

    return value


COLUMNS: dict[str, tuple[str, Callable[[Drives], float | None], str]] = {
    "count": ("drives", len, "{:.0f}"),
    "hours": ("simulated hours", lambda d: total(d, "simulated_seconds") / 3600, "{:.2f}"),
    "collisions_h": (
        "collisions/h",
        lambda d: 3600 * total(d, "collisions") / total(d, "simulated_seconds"),
        "{:.1f}",
    ),
    "stops_h": ("stops/h", lambda d: 3600 * total(d, "stopped") / total(d, "simulated_seconds"), "{:.1f}"),
    "distance_m": ("m driven", lambda d: total(d, "distance_m"), "{:.0f}"),
    "passed": ("passed within 1 m %", lambda d: total(d, "free_area_passed") / len(d), "{:.0%}"),
    "precision": ("map precision %", of_maps("precision"), "{:.0%}"),
    "surfaces": ("map within 10 cm of surfaces %", of_maps("surfaces"), "{:.0%}"),
    "recall": ("map recall %", of_maps("recall"), "{:.0%}"),
    "pose_cm": ("pose error cm", of_poses("median_m", 100), "{:.1f}"),
    "pose_degrees": ("pose error degrees", of_poses("median_degrees"), "{:.2f}"),
}
"""Heads, values over all drives of a row, and forms of the columns that are numbers."""


def rows_of(summaries: Drives) -> list[Row]:
    """One row for all drives with the same words."""
    groups: dict[tuple[str, ...], Drives] = {}
    for summary in summaries:
        groups.setdefault(tuple(str(summary.get(key, "")) for key in WORDS), []).append(summary)
    return [
        dict(zip(WORDS, words, strict=True)) | {key: column[1](d) for key, column in COLUMNS.items()} | {"drives": d}
        for words, d in groups.items()
    ]


def text_cells(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Heads and cells of the columns in which any row has something to say."""
    heads = dict(zip(WORDS, WORDS, strict=True)) | {key: column[0] for key, column in COLUMNS.items()}
    kept = [key for key in heads if any(row[key] not in (None, "") for row in rows)]
    cells = [
        [row[key] if key in WORDS else "" if row[key] is None else COLUMNS[key][2].format(row[key]) for key in kept]
        for row in rows
    ]
    return [heads[key] for key in kept], [[cell.removesuffix("%") for cell in row] for row in cells]


def markdown(rows: Sequence[Row], note: str) -> str:
    """The table in Markdown, with a line below it that says how it was made."""
    names, cells = text_cells(rows)
    words = sum(name in WORDS for name in names)
    lines = ["| " + " | ".join(names) + " |", "|---" * words + "|---:" * (len(names) - words) + "|"]
    lines += ["| " + " | ".join(cell or "-" for cell in row) + " |" for row in cells]
    return "\n".join([*lines, "", note, ""])
