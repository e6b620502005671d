"""Plots of signals and outputs over time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ndtorch.report.plots.layout import STYLES, TIME_LABEL, inches, new_figure, save
from ndtorch.run.result import Floats, RunResult
from ndtorch.vision.features import FEATURES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS = 1200
"""Most points drawn of one trace: about one a pixel."""


def draw_traces(
    axes: Axes, times: npt.NDArray[np.float64], values: Floats, which: Iterable[int], bold: Sequence[int]
) -> None:
    """Columns `which` of `values` `[n, 10]` over `times` `[n]`; the bold ones are named at their ends."""
    axes.tick_params(labelsize=8)
    axes.grid(color="0.93", lw=0.6)
    if len(times) == 0:
        axes.text(0.5, 0.5, "no samples", transform=axes.transAxes, ha="center", color="0.35")
        return
    for j in which:
        color, dashes = STYLES[FEATURES[j]]
        x, y = thinned(times, values[:, j])
        axes.plot(
            x,
            y,
            color=color,
            linestyle=dashes,
            lw=2.2 if j in bold else 1.0,
            zorder=3 if j in bold else 2,
            marker="o" if len(x) == 1 else None,
            markersize=4,
        )
    first, last = float(times[0]), float(times[-1])
    if len(times) > 1:
        axes.set_xlim(first, last)
    if first < 0:
        shade_settling(axes)
    for j, height in spread(axes, {j: float(values[-1, j]) for j in bold}).items():
        axes.annotate(
            FEATURES[j],
            (1, height),
            (4, 0),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
            weight="bold",
            color=STYLES[FEATURES[j]].color,
        )


def shade_settling(axes: Axes, words: bool = True) -> None:
    """Shade the time before learning began, and say what it is where there is room."""
    left, right = axes.get_xlim()
    edge = min(0.0, right)
    axes.axvspan(left, edge, color="0.92", lw=0, zorder=-1)
    if words and edge - left > 0.12 * (right - left):
        text = axes.text((left + edge) / 2, 0.97, "settling", transform=axes.get_xaxis_transform(), fontsize=8)
        text.set(ha="center", va="top", color="0.4")


def thinned(times: npt.NDArray[np.float64], values: Floats) -> tuple[npt.NDArray[np.float64], Floats]:
    """About `POINTS` of the `[n]` samples: smallest and largest of every stretch, so that no peak is lost."""
    n = len(times)
    if n <= POINTS:
        return times, values
    step = math.ceil(2 * n / POINTS)
    whole = n // step * step
    stretches = values[:whole].reshape(-1, step)
    starts = np.arange(0, whole, step)
    ends = [np.array([0, n - 1]), np.arange(whole, n)]
    kept = np.unique(np.concatenate([starts + stretches.argmin(1), starts + stretches.argmax(1), *ends]))
    return times[kept], values[kept]


def spread(axes: Axes, heights: dict[int, float]) -> dict[int, float]:
    """The heights of labels, in data units and inside the panel, moved apart so that one can read them."""
    low, high = axes.get_ylim()
    line = 17 * (high - low) / axes.bbox.height
    placed: dict[int, float] = {}
    floor = low + line / 2
    for j in sorted(heights, key=lambda j: heights[j]):
        placed[j] = max(heights[j], floor)
        floor = placed[j] + line
    ceiling = high - line / 2
    for j in reversed(placed):
        placed[j] = min(placed[j], ceiling)
        ceiling = placed[j] - line
    return placed


LANE = 0.52
"""Height of a lane, inches."""


def draw_outputs(result: RunResult, path: str | Path) -> Path:
    """Second-stage outputs over time, a lane a neuron, all to one scale; owners of objects are bold. [B fig. 8a, 10]"""
    height = 1.25 + 10 * LANE
    figure = new_figure(result, "outputs of the second stage", 9.6, height)
    owners = {thing.index for thing in result.objects}
    times, samples = result.outputs.times - result.settle, result.outputs.samples
    # Filters that start leave a spike: it may leave its lane.
    after = samples[times >= min(0.0, float(times[-1]))] if len(times) else samples
    top = 1.08 * max(float(np.abs(after).max(initial=0.0)), 1e-3)
    for j, name in enumerate(FEATURES):
        axes = inches(figure, 1.35, height - 0.65 - LANE * (j + 1), 7.3, LANE)
        color, owns = STYLES[name].color, j in owners
        axes.axhline(0, color="0.85", lw=0.7, zorder=0)
        if len(times):
            x, y = thinned(times, samples[:, j])
            mark = "o" if len(x) == 1 else None
            axes.plot(x, y, color=color, lw=2.0 if owns else 1.0, marker=mark, markersize=4)
        elif j == 0:
            axes.text(0.5, 0.5, "no samples", transform=axes.transAxes, ha="center", va="center", color="0.35")
        if len(times) > 1:
            axes.set_xlim(float(times[0]), float(times[-1]))
        if len(times) and times[0] < 0:
            shade_settling(axes, words=j == 3)
        axes.set_ylim(-top, top)
        axes.set_yticks([])
        axes.text(
            -0.012,
            0.5,
            name,
            transform=axes.transAxes,
            ha="right",
            va="center",
            color=color,
            fontsize=9.5,
            weight="bold" if owns else "normal",
        )
        if owns:
            axes.text(1.012, 0.5, "owns an object", transform=axes.transAxes, va="center", color=color, fontsize=7.5)
        axes.spines[["top", "right"]].set_visible(False)
        if j < 9:
            axes.tick_params(labelbottom=False, length=0)
            axes.spines["bottom"].set_color("0.9")
    axes.set_xlabel(f"{TIME_LABEL}; every lane reaches from {-top:.2g} to {top:.2g} (no unit)")
    return save(figure, path)
