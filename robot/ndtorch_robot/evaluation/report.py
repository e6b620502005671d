"""Report pages of a drive and of an evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ndtorch.report.page import Page, Shown, Table, command_line, versions
from ndtorch_robot.drive import Result
from ndtorch_robot.evaluation.table import Row, shown_cells

PACKAGES = ("ndtorch-robot",)

SHOWN = (
    (
        "path.png",
        "Where the car went",
        "The true path over the true plan, with turns, reversing, collisions and stops. The car does not know them.",
    ),
    (
        "map.png",
        "The map that it made",
        "Red: the map, the darker the more certain. Each short stroke is the certainty of one feature: narrow across "
        "the line of sight, long along it. Faint strokes away from walls are features that were seen too few times or "
        "matched wrongly between the two cameras.",
    ),
    (
        "pose.png",
        "Where it believed to be",
        "How far dead reckoning and the pose corrected by landmarks are from the truth. The dashed lines are 20 cm and "
        "3 degrees.",
    ),
    (
        "rows.png",
        "What both cameras read",
        "One row of pixels of each camera, stacked over time. Dots are features with a range. Lines that spread out "
        "are walls that pass by.",
    ),
    (
        "speeds.png",
        "Why it turned",
        "Above: how fast the image moves on both sides. Below: what the controller weighs, and where it acts.",
    ),
)


def write_drive_page(result: Result, words: str, folder: Path) -> Path:
    """Write report.html about a drive whose plots are in `folder`; `words` is the summary."""
    config = result.config
    first, *rest = words.splitlines()
    facts = {
        "arena": config.arena,
        "seed": str(config.seed),
        "controller": config.controller,
        "walls": config.walls,
        "dead reckoning": config.odometry,
        **({"disturbance": config.disturbance} if config.disturbance else {}),
        **versions(*PACKAGES),
    }
    shown = [Shown(folder / name, title, caption) for name, title, caption in SHOWN if (folder / name).exists()]
    return Page(f"A drive: {first}", [line.strip() for line in rest], command_line(), facts, (), shown).write(folder)


def write_evaluation_page(rows: Sequence[Row], note: str, folder: Path) -> Path:
    """Write report.html about an evaluation whose plot is in `folder`."""
    drives = sum(len(row["drives"]) for row in rows)
    hours = sum(row["hours"] for row in rows)
    hits = round(sum(row["hours"] * row["collisions_h"] for row in rows))
    counted = f"{drives} {'drive' if drives == 1 else 'drives'}", f"{hits} {'collision' if hits == 1 else 'collisions'}"
    answer = [f"{counted[0]}, {hours:.2f} simulated hours, {counted[1]}.", note]
    table = Table("All drives together", *shown_cells(rows))
    plot = Shown(
        folder / "table.png",
        "Collisions and area",
        "Small markers are single drives, the line spans them, large markers are all drives together.",
    )
    return Page("Many drives", answer, command_line(), versions(*PACKAGES), [table], [plot]).write(folder)
