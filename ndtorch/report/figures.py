"""The pictures of one binding run, drawn with matplotlib into PNG files. After [B fig. 8, 10] and [C fig. 6].

Time on every axis counts from the start of second-stage learning, as in the papers; what lies before is shaded.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import torch

from ndtorch.binding import object_table
from ndtorch.binding.objects import SMALLEST_WEIGHT
from ndtorch.report.palette import STYLES
from ndtorch.report.result import BindResult, Floats, Pixels, Trace
from ndtorch.vision.features import FEATURES, GROUPS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 110
POINTS = 1200
"""Most points drawn of one trace: about one a pixel."""
COLUMNS_SHOWN = 4
"""Panels of weights over time where nobody owns an object."""
TIME_LABEL = "time since learning began (s)"
MAP = "YlGnBu"
MEANING = {
    "stable": "weights stable",
    "learning": "weights still changing",
    "alternating": "ALTERNATING: outputs flip sign at every step, weights mean nothing",
    "static": "STATIC: too little fluctuates in view to bind anything",
}
"""What each verdict says, in the words of a title."""


def draw_all(result: BindResult, folder: str | Path) -> list[Path]:
    """Write outputs.png, weights.png, weights_over_time.png and frames.png into `folder`, made if missing."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    drawings = {
        "outputs": draw_outputs,
        "weights": draw_weights,
        "weights_over_time": draw_weights_over_time,
        "frames": draw_frames,
    }
    return [draw(result, folder / f"{name}.png") for name, draw in drawings.items()]


def draw_outputs(result: BindResult, path: str | Path) -> Path:
    """Second-stage outputs over time, one trace a neuron; those that own an object are bold. [B fig. 8a, 10]"""
    figure = new_figure(result, "second-stage outputs", 9.6, 5.0)
    axes = figure.add_axes((0.08, 0.115, 0.68, 0.755))
    owners = [thing.index for thing in result.objects]
    draw_traces(axes, result, result.outputs, result.outputs.samples, range(10), owners)
    axes.axhline(0, color="0.75", lw=0.8, zorder=0)
    axes.set_xlabel(TIME_LABEL)
    axes.set_ylabel("output of the neuron (group-normalised input = 1)")
    add_legend(figure, "neurons\n(bold: owns an object)", owners)
    return save(figure, path)


def draw_weights(result: BindResult, path: str | Path) -> Path:
    """The final 10 x 10 weights beside what the object table keeps of them. [B fig. 8d, e]"""
    raw = result.final_weights
    simplified = object_table(torch.from_numpy(raw)).simplified.numpy()
    figure = new_figure(result, "second-stage weights", 13.0, 6.6)
    largest = float(raw.max())
    for left, title, values, top in (
        (0.075, "learned weights", raw, largest if largest > 0 else 1.0),
        (0.570, "simplified: divided by the largest, below 1/3 removed", simplified, 1.0),
    ):
        axes = figure.add_axes((left, 0.13, 0.37, 0.70))
        picture = draw_matrix(axes, result, values, top)
        axes.set_title(title, fontsize=11, pad=22 if result.objects else 8)
        bar = figure.colorbar(picture, cax=figure.add_axes((left + 0.38, 0.13, 0.011, 0.70)))
        bar.ax.tick_params(labelsize=8)
        if not values.any():
            axes.text(4.5, 4.5, "all weights are zero", ha="center", va="center", fontsize=12, color="0.35")
    return save(figure, path)


def draw_weights_over_time(result: BindResult, path: str | Path) -> Path:
    """The weights that each owner sends to the other neurons over time, a panel an owner. [B fig. 8b, c]

    Without owners: the `COLUMNS_SHOWN` neurons with the largest sums of weights.
    """
    things = {thing.index: thing for thing in result.objects}
    shown = list(things) or sorted(np.argsort(-result.final_weights.sum(0), kind="stable")[:COLUMNS_SHOWN].tolist())
    across = 1 if len(shown) == 1 else 2 if len(shown) <= 4 else 3
    down = math.ceil(len(shown) / across)
    width, height = 1.9 + 4.4 * across, 1.2 + 2.9 * down
    figure = new_figure(result, "inhibitory weights over time", width, height)
    samples = result.weights.samples
    top = max(float(samples.max(initial=0.0)) * 1.08, 1e-3)
    threshold = float(result.final_weights.max()) * SMALLEST_WEIGHT
    for place, k in enumerate(shown):
        row, column = divmod(place, across)
        box = (0.65 + 4.4 * column, height - 3.55 - 2.9 * row, 3.55, 2.35)
        axes = figure.add_axes((box[0] / width, box[1] / height, box[2] / width, box[3] / height))
        bold = [FEATURES.index(n) for n in things[k].features if n != FEATURES[k]] if k in things else []
        others = [j for j in range(10) if j != k]
        draw_traces(axes, result, result.weights, samples[:, :, k], others, bold)
        if threshold > 0:
            axes.axhline(threshold, color="0.55", lw=0.8, zorder=0)
            start = axes.get_xlim()[0]
            axes.annotate("1/3 of largest", (start, threshold), (3, 2), textcoords="offset points", fontsize=7, color="0.4")
        axes.set_ylim(0, top)
        axes.set_title(f"from the {FEATURES[k]} neuron to:", fontsize=10, color=STYLES[FEATURES[k]].color, weight="bold")
        if column == 0:
            axes.set_ylabel("weight")
        if place + across >= len(shown):
            axes.set_xlabel(TIME_LABEL)
    note = "bold: features\nof the object" if things else "no neuron owns an\nobject: the neurons\nthat send most"
    add_legend(figure, note, [])
    return save(figure, path)


def draw_frames(result: BindResult, path: str | Path) -> Path:
    """Input beside enhanced image at the clearest moment of every winner, in the order of time. [C fig. 6]"""
    moments = sorted(result.moments.values(), key=lambda moment: moment.time)
    if not moments:
        figure = new_figure(result, "attention", 7.4, 2.6)
        words = "No object won the attention of the model in this run."
        figure.text(0.5, 0.4, words, ha="center", va="center", fontsize=12, color="0.35")
        return save(figure, path)
    tall, wide = moments[0].frame.shape[:2]
    across, down = fit(wide, tall, 3.4, 3.4 if len(moments) <= 4 else 2.4)
    width, height = max(2 * across + 0.75, 7.4), 0.95 + (down + 0.45) * len(moments)
    figure = new_figure(result, "attention", width, height)
    left = (width - 2 * across - 0.15) / 2
    for row, moment in enumerate(moments):
        bottom = height - 0.85 - (down + 0.45) * (row + 1) + 0.1
        name = FEATURES[moment.neuron]
        for column, (kind, pixels) in enumerate({"input": moment.frame, "enhanced": moment.enhanced}.items()):
            x = left + column * (across + 0.15)
            axes = figure.add_axes((x / width, bottom / height, across / width, down / height))
            axes.imshow(thin_pixels(pixels), aspect="auto", interpolation_stage="data")
            axes.set(xticks=[], yticks=[])
            words = f"input at {moment.time - result.settle:.1f} s" if kind == "input" else f"enhanced: {name} wins"
            axes.set_title(words, fontsize=10, color=STYLES[name].color if column else "black", pad=4)
    return save(figure, path)


def draw_traces(
    axes: Axes, result: BindResult, trace: Trace, values: Floats, which: Iterable[int], bold: Sequence[int]
) -> None:
    """Columns `which` of `values` `[n, 10]` over the trace's times; the bold ones are named at their ends."""
    times = trace.times - result.settle
    for j in sorted(which, key=lambda j: j in bold):
        color, dashes = STYLES[FEATURES[j]]
        thick = j in bold
        axes.plot(
            *thinned(times, values[:, j]),
            color=color,
            linestyle=dashes,
            lw=2.2 if thick else 1.0,
            alpha=1.0 if thick else 0.8,
            marker="o" if len(times) == 1 else None,
            zorder=3 if thick else 2,
        )
    if len(times) == 0:
        axes.text(0.5, 0.5, "no samples yet", transform=axes.transAxes, ha="center", color="0.35")
        return
    first, last = float(times[0]), max(float(times[-1]), float(times[0]) + 1e-2)
    axes.set_xlim(first, last)
    if first < 0:
        axes.axvspan(first, min(0.0, last), color="0.93", lw=0, zorder=-1)
        axes.annotate(
            "settling, no learning", (first, 1), (4, -4), "data", "offset points", 
        ) if False else None
    axes.grid(color="0.92", lw=0.6)
    axes.tick_params(labelsize=8)
    for j, y in spread({j: float(values[-1, j]) for j in bold}, axes):
        axes.annotate(
            FEATURES[j], (1, y), (4, 0), ("axes fraction", "data"), textcoords="offset points",
            va="center", fontsize=9, weight="bold", color=STYLES[FEATURES[j]].color,
        )
