"""The leaderboard as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ndtorch_train.score.leaderboard import Row

COLORS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#666666", "#000000")
"""Okabe and Ito's palette."""


def draw(rows: Sequence[Row], path: Path, title: str) -> Path:
    """Count, F1 and ok of every method on the random scenes, and the count on every other set."""
    from matplotlib.figure import Figure

    random = [row for row in rows if row.test == "random"]
    others = [row for row in rows if row.test != "random"]
    methods = list(dict.fromkeys(row.method for row in rows))
    colors = {name: COLORS[n % len(COLORS)] for n, name in enumerate(methods)}
    tests = list(dict.fromkeys((row.test, row.seconds) for row in others))
    height = 1.6 + 0.26 * max(len(random), len(tests) + len(methods) / 2, 6)
    figure = Figure(figsize=(13.0 if others else 7.5, height), dpi=110, layout="constrained")
    if others:
        figure.suptitle(title)
    panels = figure.subplots(1, 2 if others else 1, squeeze=False)[0]
    axes = panels[0]
    for metric, marker in (("count", "o"), ("f1", "s"), ("ok", "D")):
        for place, row in enumerate(random):
            value, error = getattr(row, metric)
            filled = colors[row.method] if metric == "count" else "white"
            axes.errorbar(
                value, -place, xerr=2 * error, fmt=marker, color=colors[row.method], mfc=filled, ms=6, capsize=2, lw=1
            )
        label, filled = "F1" if metric == "f1" else metric, "0.3" if metric == "count" else "white"
        axes.plot([], [], marker, color="0.3", mfc=filled, label=label)
    axes.set_yticks([-n for n in range(len(random))], [f"{row.method}, {row.seconds:g} s" for row in random])
    axes.set_xlim(-0.03, 1.03)
    axes.set_xlabel("share of scenes (count, ok) or mean (F1); bars: two standard errors")
    axes.set_title("random scenes" if others else title)
    axes.grid(axis="x", color="0.9")
    axes.legend(loc="center left", fontsize=8)
    if others:
        axes = panels[1]
        for n, name in enumerate(methods):
            mine = {(row.test, row.seconds): row.count[0] for row in others if row.method == name}
            places = [
                (mine[test], -place - 0.08 * (n - len(methods) / 2)) for place, test in enumerate(tests) if test in mine
            ]
            axes.plot(*zip(*places, strict=True), "o", color=colors[name], label=name, ms=5)
        axes.set_yticks([-n for n in range(len(tests))], [f"{test}, {seconds:g} s" for test, seconds in tests])
        axes.set_xlim(-0.03, 1.03)
        axes.set_xlabel("share of scenes with the right number of objects")
        axes.set_title("other sets")
        axes.grid(axis="x", color="0.9")
        axes.legend(loc="lower left", fontsize=8)
    figure.savefig(path)
    return path
