"""What was reached in the worlds of the BARN challenge: kept, as a table, and drawn."""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ndtorch.utils.files import write_text
from ndtorch.utils.packages import code_digest
from ndtorch_robot.barn.attempt import Attempt, Entry
from ndtorch_robot.barn.worlds import World
from ndtorch_robot.evaluation.drives import CODE, PACKAGES

COLUMNS = ("world", "success", "collided", "time_s", "score")
"""Of `barn.csv`."""

HIT, DONE, LATE = "#d55e00", "#009e73", "#0072b2"
"""Colors of the ways that ended in a collision, at the goal, and when the time was over."""


class Kept:
    """Attempts that are finished, one file each, so that a run can go on where it was stopped."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.code = folder, code_digest(CODE, PACKAGES)

    def file(self, entry: Entry) -> Path:
        """Where an attempt is or will be: another name for another world, driver, seed or code."""
        text = json.dumps([dataclasses.asdict(entry), self.code], sort_keys=True)
        return self.folder / f"{entry.world.number:04d}-{hashlib.sha256(text.encode()).hexdigest()[:12]}.json"

    def get(self, entry: Entry) -> Attempt | None:
        """An attempt that was made before, or None."""
        try:
            found = json.loads(self.file(entry).read_text(encoding="utf-8"))
        except (FileNotFoundError, json.JSONDecodeError):
            return None
        return Attempt(**{**found, "path": [tuple(place) for place in found["path"]]})

    def put(self, entry: Entry, made: Attempt) -> None:
        """Keep an attempt. Written beside and moved, so that there is never half a file."""
        file = self.file(entry)
        file.parent.mkdir(parents=True, exist_ok=True)
        write_text(file, json.dumps(made._asdict()) + "\n")


def comma_separated(made: Sequence[Attempt]) -> str:
    """`barn.csv`."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows([a.world, int(a.success), int(a.collided), f"{a.time_s:.2f}", f"{a.score:.4f}"] for a in made)
    return text.getvalue()


def totals(made: Sequence[Attempt]) -> dict[str, float]:
    """Shares and means over all attempts; times over those that reached the goal."""
    times = [a.time_s for a in made if a.success]
    return {
        "worlds": len(made),
        "success": float(np.mean([a.success for a in made])) if made else 0.0,
        "collisions": float(np.mean([a.collided for a in made])) if made else 0.0,
        "score": float(np.mean([a.score for a in made])) if made else 0.0,
        "median_time_s": float(np.median(times)) if times else float("nan"),
    }


def table(made: Sequence[Attempt], note: str) -> str:
    """The totals in Markdown, with the worlds that were not passed."""
    t = totals(made)
    lines = [
        "| worlds | success | collisions | score | median time to the goal |",
        "|---:|---:|---:|---:|---:|",
        f"| {len(made)} | {t['success']:.2f} | {t['collisions']:.2f} | {t['score']:.3f} | {t['median_time_s']:.1f} s |",
        "",
    ]
    for words, some in (
        ("Collided", [a for a in made if a.collided]),
        ("Out of time", [a for a in made if not a.collided and not a.success]),
    ):
        if some:
            lines += [f"{words}: " + ", ".join(f"{a.world} ({a.time_s:.0f} s)" for a in some) + ".", ""]
    return "\n".join([*lines, note, ""])


def draw(worlds: Sequence[World], made: Sequence[Attempt], file: Path, most: int = 60) -> None:
    """All worlds side by side with the way through each; of more than `most` those that come first."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.collections import PatchCollection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Circle

    ways = {a.world: a for a in made}
    shown = [w for w in worlds if w.number in ways][:most]
    across = min(10, max(1, len(shown)))
    down = -(-len(shown) // across)
    figure, axes = plt.subplots(down, across, figsize=(1.25 * across, 2.9 * down + 0.4), squeeze=False)
    for ax in axes.flat:
        ax.set_axis_off()
    for ax, world in zip(axes.flat, shown, strict=False):
        way = ways[world.number]
        color = DONE if way.success else HIT if way.collided else LATE
        ax.add_collection(PatchCollection([Circle(c, world.radius) for c in world.cylinders], color="0.55", lw=0))
        ax.add_patch(Circle(world.goal, world.within, fill=False, color="0.4", lw=0.8))
        path: Any = np.array(way.path)
        if len(path):
            ax.plot(path[:, 0], path[:, 1], color=color, lw=1.4)
            ax.plot(*path[-1], "X" if way.collided else "o", color=color, ms=5 if way.collided else 3)
        xs = [c[0] for c in world.cylinders]
        ax.set_xlim(min(xs) - 0.3, max(xs) + 0.3)
        ax.set_ylim(world.start[1] - 0.8, world.goal[1] + 1.2)
        ax.set_aspect("equal")
        ax.set_title(f"{world.number}: {way.time_s:.0f} s", fontsize=7, pad=1)
    handles = [Line2D([], [], color=c, label=words) for c, words in LEGEND]
    figure.legend(handles=handles, loc="lower center", ncols=3, frameon=False, fontsize=8)
    figure.subplots_adjust(left=0.01, right=0.99, top=1 - 0.25 / (2.9 * down + 0.4), bottom=0.4 / (2.9 * down + 0.4))
    figure.savefig(file, dpi=110)
    plt.close(figure)


LEGEND = ((DONE, "reached the goal"), (HIT, "collided"), (LATE, "out of time"))
"""What the colors mean."""
