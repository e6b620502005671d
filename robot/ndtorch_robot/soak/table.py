"""What all pieces of a soak say together."""

from __future__ import annotations

from statistics import median
from typing import Any

import numpy as np

from ndtorch_robot.soak.faults import FAULTS
from ndtorch_robot.soak.piece import Piece

COLUMNS = (
    "part",
    "fault",
    "may turn s",
    "tried",
    "bad",
    "wheels turned, median s",
    "longest s",
    "drives on after, median s",
)

MOST_GROWTH = 10.0
"""Megabytes an hour by which the memory of the process may grow."""

SETTLES = 6
"""Pieces of a process after which its memory is compared: the first ones load and compile, each in another arena."""


def table(pieces: list[Piece]) -> str:
    """One line for each fault, in Markdown."""
    rows = [row for piece in pieces for row in piece["faults"]]
    lines = ["| " + " | ".join(COLUMNS) + " |", "|---|---|---:|---:|---:|---:|---:|---:|"]
    for fault in FAULTS:
        mine = [row for row in rows if row["part"] == fault.part and row["fault"] == fault.name]
        turned = [row["turned"] for row in mine if row["turned"] is not None]
        on = [row["on after"] for row in mine if row["on after"] is not None]
        cells = [
            fault.part,
            fault.name,
            "drives on" if fault.within is None else f"{fault.within:g}",
            str(len(mine)),
            str(sum(row["bad"] is not None for row in mine)),
            f"{median(turned):.2f}" if turned else "-",
            f"{max(turned):.2f}" if turned else "-",
            f"{median(on):.1f}" if on else "-",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def growth(pieces: list[Piece]) -> float | None:
    """Megabytes an hour of driving by which the memory grew: the slope that fits all processes best, each by itself.

    None before it can be said. Buildings differ in size, so two pieces alone say little.
    """
    moved = spread = 0.0
    for process in dict.fromkeys(piece["process"] for piece in pieces):
        mine = [piece for piece in pieces if piece["process"] == process]
        hours = np.cumsum([piece["seconds"] for piece in mine])[SETTLES:] / 3600
        if len(hours) > 1:
            from_middle = hours - hours.mean()
            moved += float(from_middle @ [piece["megabytes"] for piece in mine[SETTLES:]])
            spread += float(from_middle @ from_middle)
    return moved / spread if spread else None


def summary(pieces: list[Piece]) -> dict[str, Any]:
    """The figures of a soak. A piece in which the car never began tried no fault; such ones are counted."""
    rows = [row for piece in pieces for row in piece["faults"]]
    grown = growth(pieces)
    return {
        "pieces": len(pieces),
        "pieces_without_a_fault": sum(not piece["faults"] for piece in pieces),
        "hours": round(sum(piece["seconds"] for piece in pieces) / 3600, 3),
        "wall_hours": round(sum(piece["wall_seconds"] for piece in pieces) / 3600, 3),
        "faults": len(rows),
        "bad": sum(row["bad"] is not None for row in rows),
        "unexplained_stops": sum(len(piece["unexplained"]) for piece in pieces),
        "stops_before_blank_walls": sum(len(piece["blank"]) for piece in pieces),
        "stops_when_put_elsewhere": sum(len(piece["carried"]) for piece in pieces),
        "collisions": sum(piece["collisions"] for piece in pieces),
        "megabytes_an_hour": None if grown is None else round(grown, 1),
    }


def troubles(pieces: list[Piece]) -> list[str]:
    """Everything that should not have been, one line each."""
    found = []
    for piece in pieces:
        where = f"piece {piece['number']}, {piece['arena']}"
        found += [f"{where}: unexplained stop at {line}" for line in piece["unexplained"]]
        bad = [row for row in piece["faults"] if row["bad"] is not None]
        found += [f"{where}, {row['at']:.2f} s: {row['part']}, {row['fault']}: {row['bad']}" for row in bad]
    grown = growth(pieces)
    if grown is not None and grown > MOST_GROWTH:
        found.append(f"memory grew by {grown:.1f} MB an hour, {MOST_GROWTH:g} are allowed")
    return found


def report(pieces: list[Piece]) -> str:
    """The table, the figures, and what should not have been."""
    figures = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in summary(pieces).items())
    bad = troubles(pieces)
    return "\n".join([table(pieces), "", f"{figures}.", "", *(f"- {line}" for line in bad), ""])
