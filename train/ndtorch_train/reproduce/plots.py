"""What the figures share: sizes, colors, panels of outputs and of weight matrices."""

from __future__ import annotations

import string
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

from ndtorch.report.figures.traces import draw_traces
from ndtorch.report.figures.weights import draw_matrix
from ndtorch.report.palette import STYLES
from ndtorch.vision import FEATURES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, PURPLE, SKY, YELLOW, BLACK = (
    "#0072b2",
    "#d55e00",
    "#009e73",
    "#cc79a7",
    "#56b4e9",
    "#e69f00",
    "#222222",
)
"""Okabe & Ito's colors, told apart by the color-blind."""


def panels(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple[Figure, list[Axes]]:
    """A figure of `width` x `height` inches with a grid of axes, in the order of reading."""
    from matplotlib.figure import Figure

    figure = Figure((width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, list(axes.flat)


def letters(axes: list[Axes], which: str = string.ascii_lowercase) -> None:
    """(a), (b), ... before the titles."""
    for letter, one in zip(which, axes, strict=False):
        one.set_title(f"({letter}) {one.get_title()}", fontsize=10, loc="left")
        one.set_title("")


def output_panel(
    axes: Axes,
    time: Tensor,
    outputs: Tensor,
    title: str,
    bold: list[str],
    until: float | None = None,
    since: float = -1.0,
) -> None:
    """Outputs of the second stage over the time since learning began."""
    shown = (time >= since) & (time <= (float(time[-1]) if until is None else until))
    axes.axhline(0, color="0.75", lw=0.8, zorder=0)
    names = [FEATURES.index(name) for name in bold]
    draw_traces(axes, time[shown].numpy(), outputs[shown].numpy(), range(10), names)
    axes.set(title=title, xlabel="time since learning began (s)", ylabel="output")


def matrix_panel(axes: Axes, weights: Tensor, title: str, simplified: bool = False) -> None:
    """A 10 x 10 weight matrix as learned, or divided by its largest and cut at a third of it."""
    from ndtorch.binding.readout.weights import simplified as simplified_weights

    values = simplified_weights(weights) if simplified else weights
    largest = float(values.max())
    draw_matrix(axes, values.numpy(), largest if largest > 0 else 1.0)
    axes.set_xlabel("FROM this neuron", fontsize=8)
    axes.set_ylabel("TO this neuron", fontsize=8)
    axes.set_title(title)


def weight_panel(axes: Axes, time: Tensor, weights: Tensor, column: int, title: str) -> None:
    """Weights from one neuron to the others over time, `weights` `[samples, 10, 10]`."""
    shown = time >= 0
    time, weights = time[shown], weights[shown]
    trace = weights[:, :, column]
    bold = [j for j in range(10) if j != column and float(trace[-1, j]) > 1 / 3 * float(weights[-1].max())]
    draw_traces(axes, time.numpy(), trace.numpy(), [j for j in range(10) if j != column], bold)
    axes.set(title=title, xlabel="time since learning began (s)", ylabel="weight")


def feature_legend(figure: Figure, columns: int = 10) -> None:
    """All ten lines below the panels."""
    from matplotlib.lines import Line2D

    lines = [Line2D([], [], color=s.color, linestyle=s.dashes, lw=1.8, label=name) for name, s in STYLES.items()]
    figure.legend(handles=lines, loc="outside lower center", ncols=columns, fontsize=8.5, frameon=False, handlelength=3)


def bare(axes: Axes, image: Any, title: str = "") -> None:
    """A picture without ticks."""
    axes.imshow(np.asarray(image), interpolation="nearest")
    axes.set(xticks=[], yticks=[], title=title)
