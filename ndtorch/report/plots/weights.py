"""The weights: at the end as a matrix, and over time."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ndtorch.report.plots.layout import STYLES, TIME_LABEL, add_legend, inches, new_figure, save
from ndtorch.report.plots.signals import draw_traces
from ndtorch.run.result import Floats, RunResult
from ndtorch.vision.features import FEATURES, GROUPS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.image import AxesImage

COLUMNS_SHOWN = 4
"""Panels of weights over time where nobody owns an object."""


def draw_weights(result: RunResult, path: str | Path) -> Path:
    """The final 10 x 10 weights beside the table of objects, owners as columns. [B fig. 8d, e]"""
    raw = result.final_weights
    assert result.table is not None
    kept = result.table.rows.mT.float().cpu().numpy() if result.objects else np.zeros_like(raw)
    figure = new_figure(result, "weights of the second stage", 13.2, 6.7)
    largest = float(raw.max())
    panels = {
        "as learned": (raw, largest or 1.0),
        "as read: a column of features for every object": (kept, 1.0),
    }
    for left, (title, (values, top)) in zip((1.0, 7.45), panels.items(), strict=True):
        read = values is kept
        empty = "no objects" if read else "all weights are zero"
        picture = draw_matrix(inches(figure, left, 0.95, 4.85, 4.55), values, top, empty)
        axes = picture.axes
        if read:
            axes.set(xlabel="Each column: the object of this neuron", ylabel="Each row: its share of this feature")
        axes.set_title(title, fontsize=11, pad=24 if result.objects else 8)
        for thing in result.objects:
            axes.annotate(
                "▼\nowner",
                (thing.index, 1),
                (0, 17),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                ha="center",
                va="top",
                fontsize=7,
                linespacing=0.9,
                color=STYLES[thing.neuron].color,
            )
        bar = figure.colorbar(picture, cax=inches(figure, left + 4.95, 0.95, 0.14, 4.55))
        bar.ax.tick_params(labelsize=8)
        bar.set_label("share of the feature" if read else "weight (no unit)", fontsize=8)
    return save(figure, path)


def draw_weights_over_time(result: RunResult, path: str | Path) -> Path:
    """The weights that each owner sends to the other neurons over time, a panel an owner. [B fig. 8b, c]

    Without owners: the `COLUMNS_SHOWN` neurons with the largest sums of weights.
    """
    things = {thing.index: thing for thing in result.objects}
    largest = np.argsort(-result.final_weights.sum(0), kind="stable")[:COLUMNS_SHOWN]
    shown: list[int] = list(things) or largest.tolist()
    across = 1 if len(shown) == 1 else 2 if len(shown) <= 4 else 3
    down = math.ceil(len(shown) / across)
    height = 0.9 + 2.9 * down
    figure = new_figure(result, "weights over time", 2.3 + 4.4 * across, height)
    times, samples = result.weights.times - result.settle, result.weights.samples
    top = max(1.08 * float(samples.max(initial=0.0)), 1e-3)
    for place, k in enumerate(shown):
        row, column = divmod(place, across)
        axes = inches(figure, 0.75 + 4.4 * column, height - 3.25 - 2.9 * row, 3.5, 2.35)
        axes.set_ylim(0, top)
        bold = [FEATURES.index(n) for n in things[k].features if n != FEATURES[k]] if k in things else []
        draw_traces(axes, times, samples[:, :, k], [j for j in range(10) if j != k], bold)
        axes.set_title(
            f"from the {FEATURES[k]} neuron to:", fontsize=10, color=STYLES[FEATURES[k]].color, weight="bold"
        )
        if column == 0:
            axes.set_ylabel("weight (no unit)")
        if place + across >= len(shown):
            axes.set_xlabel(TIME_LABEL)
    features = "bold: feature of\nthe object"
    add_legend(figure, features if things else "no neuron owns\nan object; these\nsend the most", [])
    return save(figure, path)


def draw_matrix(axes: Axes, values: Floats, top: float, empty: str = "all weights are zero") -> AxesImage:
    """A 10 x 10 matrix with the names of the features: `values[n, k]` is the weight from neuron k to neuron n. Cells of
    a third of `top` and more show their value; `empty` is written where there is nothing.
    """
    picture = axes.imshow(values, cmap="Blues", vmin=0, vmax=top, aspect="auto")
    axes.set_xticks(range(10), FEATURES, rotation=45, fontsize=9)
    axes.set_yticks(range(10), FEATURES, fontsize=9)
    axes.tick_params(length=0)
    for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
        label.set_color(STYLES[label.get_text()].color)
    axes.set_xlabel("Each column: weights FROM this neuron")
    axes.set_ylabel("Each row: weights TO this neuron")
    for group in GROUPS.values():
        if group.start:
            axes.axhline(group.start - 0.5, color="0.4", lw=1.0)
            axes.axvline(group.start - 0.5, color="0.4", lw=1.0)
    if not values.any():
        axes.text(4.5, 4.5, empty, ha="center", va="center", fontsize=12, color="0.35")
        return picture
    for n, k in np.argwhere(values >= top / 3).tolist():
        ink = "white" if values[n, k] > 0.55 * top else "black"
        axes.text(k, n, f"{values[n, k]:.2f}", ha="center", va="center", fontsize=8, color=ink)
    return picture
