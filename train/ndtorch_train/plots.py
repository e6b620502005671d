"""All plots of training: panels of outputs and weights, reliability of confidence, heat maps of sweeps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

from ndtorch.report.page import Shown
from ndtorch.report.plots import STYLES, draw_matrix, draw_traces
from ndtorch.vision import FEATURES

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, PURPLE = "#0072b2", "#d55e00", "#009e73", "#cc79a7"
SKY, YELLOW, BLACK = "#56b4e9", "#e69f00", "#222222"
"""The color-blind safe palette of Okabe and Ito."""
PALETTE = (BLUE, YELLOW, GREEN, PURPLE, SKY, ORANGE, "#666666", "#000000")
"""Colors of methods, in their order."""
DPI = 110


def panels(layout: Any, width: float, height: float, **options: Any) -> tuple[Figure, list[Axes]]:
    """A figure of `width` x `height` inches and its axes, laid out as a mosaic such as "aa;bc"."""
    from matplotlib.figure import Figure

    figure = Figure((width, height), layout="constrained")
    return figure, list(figure.subplot_mosaic(layout, **options).values())


def output_panel(
    axes: Axes, time: Tensor, outputs: Tensor, title: str, bold: Sequence[str] = (), until: float = np.inf
) -> None:
    """Outputs of the second stage over the time since learning began."""
    shown = (time >= 0) & (time <= until)
    axes.axhline(0, color="0.75", lw=0.8, zorder=0)
    names = [FEATURES.index(name) for name in bold]
    draw_traces(axes, time[shown].numpy(), outputs[shown].numpy(), range(10), names)
    axes.set(title=title, xlabel="time since learning began (s)", ylabel="output")


def matrix_panel(axes: Axes, weights: Tensor, title: str, simplified: bool = False) -> None:
    """A 10 x 10 weight matrix as learned, or divided by its largest and cut at a third of it."""
    from ndtorch.binding.objects import simplified as simplified_weights

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


def feature_legend(figure: Figure) -> None:
    """All ten lines below the panels."""
    from matplotlib.lines import Line2D

    lines = [Line2D([], [], color=s.color, linestyle=s.dashes, lw=1.8, label=name) for name, s in STYLES.items()]
    figure.legend(handles=lines, loc="outside lower center", ncols=10, fontsize=8.5, frameon=False, handlelength=3)


def bare(axes: Axes, image: Any, title: str = "") -> None:
    """An image without ticks."""
    axes.imshow(np.asarray(image), interpolation="nearest")
    axes.set(xticks=[], yticks=[], title=title)


def draw_reliability(rows: list[dict[str, Any]], folder: Path) -> list[Shown]:
    """Ratio of right answers against confidence; areas grow with the root of the number of answers."""
    figure, (one,) = panels("a", 4, 4)
    one.plot([0, 1], [0, 1], color="0.7", lw=1)
    for row, color in zip(rows, PALETTE, strict=False):
        answers, right, confidence = (np.array(part)[np.array(row["bins"][0]) > 0] for part in row["bins"])
        at, ratio, areas = confidence / answers, right / answers, 300 * np.sqrt(answers / answers.sum())
        one.plot(at, ratio, color=color, lw=1.5, label=row["method"])
        one.scatter(at, ratio, areas, color=color, alpha=0.4)
    one.set(xlabel="confidence", ylabel="ratio of right answers", xlim=(0, 1.05), ylim=(-0.05, 1.05))
    one.grid(color="0.9")
    one.legend(fontsize=8)
    path = folder / "reliability.png"
    figure.savefig(path, dpi=DPI)
    return [Shown(path, "Reliability of the confidence", "A calibrated confidence lies on the diagonal.")]


def draw_heat_map(frame: pandas.DataFrame, axes: Sequence[str], value: str, title: str, path: Path) -> None:
    """Means of a result over two parameters, a panel for each of at most six values of a third.

    Args:
        frame: a row a trial.
        axes: names of one to three parameters: along x, along y, and from panel to panel.
        value: name of the result.
        title: of the sweep.
        path: to write.
    """
    import pandas

    means = frame.assign(**{value: frame[value].astype(float)})
    for name in axes[:2]:
        if means[name].nunique() > 40:  # a random sweep: the lower edges of twelve bins
            means[name] = pandas.qcut(means[name], 12, duplicates="drop").map(lambda bin: bin.left).astype(float)
    parts = [(value, means)] if len(axes) < 3 else [(f"{axes[2]} {k}", part) for k, part in means.groupby(axes[2])][:6]
    figure, shown = panels([[str(n) for n in range(len(parts))]], 1.2 + 5.2 * len(parts), 4.6)
    numbers = means[value]
    low, high = (0.0, 1.0) if numbers.between(0, 1).all() else (numbers.min(), numbers.max())
    for one, (name, part) in zip(shown, parts, strict=True):
        table = part.pivot_table(value, list(axes[1:2]), axes[0])
        image = one.imshow(table, origin="lower", aspect="auto", cmap="cividis", vmin=low, vmax=high)
        for axis, labels in ((one.xaxis, table.columns), (one.yaxis, table.index)):
            step = -(-len(labels) // 12)
            names = [f"{label:.3g}" if isinstance(label, float) else str(label) for label in labels[::step]]
            axis.set_ticks(range(0, len(labels), step), names)
        one.set(title=name, xlabel=axes[0], ylabel="".join(axes[1:2]))
    figure.colorbar(image, ax=shown, label=value)
    figure.suptitle(f"{title}: mean {value} of {len(frame)} trials", fontsize=11)
    figure.savefig(path, dpi=DPI)
