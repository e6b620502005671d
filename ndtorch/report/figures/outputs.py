"""The outputs of the second stage: a lane a neuron, so that ten traces are no tangle."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ndtorch.report.figures.layout import TIME_LABEL, inches, new_figure, save
from ndtorch.report.figures.traces import shade_settling, thinned
from ndtorch.report.palette import STYLES
from ndtorch.run.result import RunResult
from ndtorch.vision.features import FEATURES

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
