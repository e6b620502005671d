"""The picture of an evaluation: collisions and coverage of every arena and controller, with every drive."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ndtorch_robot.evaluation.table import Row, number

STYLES = (("#0072b2", "o"), ("#d55e00", "s"), ("#009e73", "^"), ("#cc79a7", "D"), ("#e69f00", "v"), ("#56b4e9", "P"))
"""Color and marker of each controller: told apart by shape as well."""


def draw_table(rows: list[Row], file: Path) -> None:
    """Write the picture. Small signs are single drives, the line spans them, large signs are all drives together."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    places = list(dict.fromkeys(place_of(row) for row in rows))
    controllers = list(dict.fromkeys(row.controller for row in rows))
    high = max(2.4, 0.5 + 0.22 * len(places) * (len(controllers) + 0.6)) + 1.0
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, high), sharey=True, layout="constrained")
    for row in rows:
        place = places.index(place_of(row))
        which = controllers.index(row.controller)
        y = place + (which - (len(controllers) - 1) / 2) * min(0.3, 0.8 / len(controllers))
        color, marker = STYLES[which % len(STYLES)]
        hits = [number(d["collisions"]) / number(d["simulated_seconds"]) * 3600 for d in row.drives]
        passed = [100 * number(d["free_area_passed"]) for d in row.drives]
        for axes, each, mean in ((left, hits, row.collisions_h), (right, passed, 100 * row.passed)):
            axes.plot([min(each), max(each)], [y, y], color=color, lw=1.5, alpha=0.6, zorder=2)
            axes.plot(each, np.full(len(each), y), marker, color=color, ms=5, alpha=0.7, ls="none", zorder=3, mew=0)
            axes.plot([mean], [y], marker, color=color, ms=9, mec="white", ls="none", zorder=4)
    finish(left, right, places)
    for which, controller in enumerate(controllers):
        color, marker = STYLES[which % len(STYLES)]
        left.plot([], [], marker, color=color, ms=9, mec="white", ls="none", label=controller)
    left.plot([], [], "o", color="0.4", ms=5, alpha=0.7, mew=0, ls="none", label="a single drive")
    figure.legend(loc="outside lower center", ncols=len(controllers) + 1, frameon=False)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def place_of(row: Row) -> tuple[str, str]:
    """Where was driven, and how it looked there."""
    return row.arena, ", ".join(filter(None, (row.walls, row.disturbance)))


def finish(left: Any, right: Any, places: list[tuple[str, str]]) -> None:
    """Axes, units and what is better."""
    several = len({walls for _, walls in places}) > 1
    names = [f"{Path(arena).stem}, {walls}" if several else Path(arena).stem for arena, walls in places]
    left.set_yticks(range(len(places)), names)
    left.set_ylim(len(places) - 0.45, -0.55)
    left.set_xscale("symlog", linthresh=2, linscale=0.6)
    left.set_xlim(left=-0.15)
    top = max(left.get_xlim()[1], 10)
    ticks = [t for t in (0, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000) if t <= top]
    left.set_xlim(-0.15, top * 1.1)
    left.set_xticks(ticks, [str(t) for t in ticks])
    left.minorticks_off()
    left.set_xlabel("collisions per simulated hour (fewer is better)")
    right.set_xlim(-2, 102)
    right.set_xlabel("free area passed within 1 m, % (more is better)")
    for axes in (left, right):
        axes.grid(axis="x", color="0.9", zorder=0)
        for k in range(1, len(places)):
            axes.axhline(k - 0.5, color="0.85", lw=0.8, zorder=1)
        axes.spines[["top", "right"]].set_visible(False)
