"""Where ranges were found in a picture, and which are right."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ndtorch_train.score.ranges.methods import Found
from ndtorch_train.score.ranges.pairs import Pair

COLORS = {"right": "#0072b2", "wrong": "#e69f00", "unknown": "#999999"}


def draw(pair: Pair, found: Found, path: Path) -> Path:
    """The left picture with a point at every range: right to 10 %, wrong, or of unknown truth."""
    from matplotlib.figure import Figure

    height, width = pair.left.shape
    figure = Figure(figsize=(9.0, 9.0 * height / width), dpi=110)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(pair.left, cmap="gray", vmin=-80, vmax=335)
    axes.set_axis_off()
    true = pair.truth[found.row, found.column]
    right = np.abs(true / found.disparity - 1) <= 0.1
    for name, chosen in (("unknown", true <= 0), ("right", (true > 0) & right), ("wrong", (true > 0) & ~right)):
        axes.plot(found.column[chosen], found.row[chosen], ".", ms=5, color=COLORS[name], mew=0)
    figure.savefig(path)
    return path
