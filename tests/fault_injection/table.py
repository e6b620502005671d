"""The summary of all scenarios of a run."""

from __future__ import annotations

from statistics import median
from typing import Any

import numpy as np

from tests.fault_injection.faults import FAULTS
from tests.fault_injection.scenario import Scenario

COLUMNS = (
    "part",
    "fault",
    "max reaction s",
    "injected",
    "failed",
    "reaction, median s",
    "longest s",
    "recovery, median s",
)

MAX_GROWTH = 10.0
"""Megabytes an hour by which the memory of the process may grow."""

SETTLING = 6
"""Scenarios of a process that load and compile; later ones are compared by their memory."""


def table(scenarios: list[Scenario]) -> str:
    """One line for each fault, in Markdown."""
    rows = [row for scenario in scenarios for row in scenario["faults"]]
    lines = ["| " + " | ".join(COLUMNS) + " |", "|---|---|---:|---:|---:|---:|---:|---:|"]
    for fault in FAULTS:
        mine = [row for row in rows if row["part"] == fault.part and row["fault"] == fault.name]
        reaction = [row["reaction_s"] for row in mine if row["reaction_s"] is not None]
        recovery = [row["recovered_s"] for row in mine if row["recovered_s"] is not None]
        cells = [
            fault.part,
            fault.name,
            "drives on" if fault.max_reaction_s is None else f"{fault.max_reaction_s:g}",
            str(len(mine)),
            str(sum(row["failure"] is not None for row in mine)),
            f"{median(reaction):.2f}" if reaction else "-",
            f"{max(reaction):.2f}" if reaction else "-",
            f"{median(recovery):.1f}" if recovery else "-",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def memory_growth(scenarios: list[Scenario]) -> float | None:
    """Megabytes an hour of driving by which the memory grew: one slope fitted to all processes, each with its offset.

    None while there are too few scenarios. Buildings differ in size, so two of them alone say little.
    """
    moved = spread = 0.0
    for process in dict.fromkeys(scenario["process"] for scenario in scenarios):
        mine = [scenario for scenario in scenarios if scenario["process"] == process]
        hours = np.cumsum([scenario["seconds"] for scenario in mine])[SETTLING:] / 3600
        if len(hours) > 1:
            centred = hours - hours.mean()
            moved += float(centred @ [scenario["megabytes"] for scenario in mine[SETTLING:]])
            spread += float(centred @ centred)
    return moved / spread if spread else None


def summary(scenarios: list[Scenario]) -> dict[str, Any]:
    """The figures of a run, with the number of scenarios in which the car never began to drive."""
    rows = [row for scenario in scenarios for row in scenario["faults"]]
    growth = memory_growth(scenarios)
    return {
        "scenarios": len(scenarios),
        "scenarios_without_a_fault": sum(not scenario["faults"] for scenario in scenarios),
        "hours": round(sum(scenario["seconds"] for scenario in scenarios) / 3600, 3),
        "wall_hours": round(sum(scenario["wall_seconds"] for scenario in scenarios) / 3600, 3),
        "faults": len(rows),
        "failed": sum(row["failure"] is not None for row in rows),
        "unexplained_stops": sum(len(scenario["unexplained"]) for scenario in scenarios),
        "stops_before_blank_walls": sum(len(scenario["blank"]) for scenario in scenarios),
        "collisions": sum(scenario["collisions"] for scenario in scenarios),
        "megabytes_an_hour": None if growth is None else round(growth, 1),
    }


def failures(scenarios: list[Scenario]) -> list[str]:
    """Every unexplained stop, late reaction and memory leak, one line each."""
    found = []
    for scenario in scenarios:
        where = f"scenario {scenario['number']}, {scenario['arena']}"
        found += [f"{where}: unexplained stop at {line}" for line in scenario["unexplained"]]
        failed = [row for row in scenario["faults"] if row["failure"] is not None]
        found += [f"{where}, {row['time_s']:.2f} s: {row['part']}, {row['fault']}: {row['failure']}" for row in failed]
    growth = memory_growth(scenarios)
    if growth is not None and growth > MAX_GROWTH:
        found.append(f"memory grew by {growth:.1f} MB an hour, {MAX_GROWTH:g} are allowed")
    return found


def report(scenarios: list[Scenario]) -> str:
    """The table, the figures and the failures, in Markdown."""
    figures = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in summary(scenarios).items())
    lines = [f"- {line}" for line in failures(scenarios)]
    return "\n".join([table(scenarios), "", f"{figures}.", "", *lines, ""])
