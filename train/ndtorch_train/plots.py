"""All plots of training: panels of outputs and weights, tables of benchmarks, heat maps of sweeps."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from torch import Tensor

from ndtorch.report.page import Shown
from ndtorch.report.plots import STYLES, draw_matrix, draw_traces
from ndtorch.utils.files import replacing
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


def save(figure: Figure, path: Path) -> Path:
    """Write a figure; an unfinished file never takes the place of an old one."""
    with replacing(path) as beside:
        figure.savefig(beside, format=path.suffix[1:], dpi=DPI)
    return path


def panels(rows: int, columns: int, width: float, height: float, **options: Any) -> tuple[Figure, list[Axes]]:
    """A figure of `width` x `height` inches with a grid of axes, in the order of reading."""
    from matplotlib.figure import Figure

    figure = Figure((width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, list(axes.flat)


def letters(figure: Figure, first: str = "a") -> None:
    """(a), (b), ... before the titles of a figure of several panels."""
    axes = [one for one in figure.axes if one.get_label() != "<colorbar>"]
    for n, one in enumerate(axes if len(axes) > 1 else (), ord(first)):
        one.set_title(f"({chr(n)}) {one.get_title()}", fontsize=10, loc="left")
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
    from ndtorch.binding.readout.owners import simplified as simplified_weights

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
    """An image without ticks."""
    axes.imshow(np.asarray(image), interpolation="nearest")
    axes.set(xticks=[], yticks=[], title=title)


def draw_reliability(rows: list[dict[str, Any]], folder: Path) -> list[Shown]:
    """Ratio of right answers against confidence; areas grow with the root of the number of answers."""
    figure, (one,) = panels(1, 1, 4, 4)
    one.plot([0, 1], [0, 1], color="0.7", lw=1)
    for row, color in zip(rows, PALETTE, strict=False):
        answers, right, confidence = (np.array(part)[np.array(row["bins"][0]) > 0] for part in row["bins"])
        at, ratio, areas = confidence / answers, right / answers, 300 * np.sqrt(answers / answers.sum())
        one.plot(at, ratio, color=color, lw=1.5, label=row["method"])
        one.scatter(at, ratio, areas, color=color, alpha=0.4)
    one.set(xlabel="confidence", ylabel="ratio of right answers", xlim=(0, 1.05), ylim=(-0.05, 1.05))
    one.grid(color="0.9")
    one.legend(fontsize=8)
    path = save(figure, folder / "reliability.png")
    return [Shown(path, "Reliability of the confidence", "A calibrated confidence lies on the diagonal.")]


def draw_ranges(left: Any, row: Any, column: Any, kinds: dict[str, Any], path: Path) -> Path:
    """The left image with a point at every range.

    Args:
        left: grey, `[H, W]`.
        row, column: of the ranges, `[n]`.
        kinds: which of them are "unknown", "right" and "wrong", `[n]` bool each.
        path: to write.
    """
    from matplotlib.figure import Figure

    height, width = left.shape
    figure = Figure(figsize=(9.0, 9.0 * height / width))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(left, cmap="gray", vmin=-80, vmax=335)
    axes.set_axis_off()
    for (name, chosen), color in zip(kinds.items(), ("#999999", BLUE, YELLOW), strict=True):
        axes.plot(column[chosen], row[chosen], ".", ms=5, color=color, mew=0, label=name)
    return save(figure, path)


UNITS = {
    "phase": "degrees", "offset": "px", "gamma": "1/s", "tau_in": "s", "tau_out": "s", "tau_onset": "s", "window": "s",
    "seconds": "s", "reach": "m", "min_disparity": "px", "max_disparity": "px", "features": "a frame",
}  # fmt: skip
"""Units of the parameters of sweeps."""


def draw_heat_map(frame: pandas.DataFrame, axes: Sequence[str], value: str, title: str, path: Path) -> Path:
    """Means of a result over two parameters, a panel for each of at most six values of a third.

    Args:
        frame: a row a trial.
        axes: names of the parameters along x, along y, and from panel to panel; "" for none.
        value: name of the result.
        title: of the sweep.
        path: to write.
    """
    import matplotlib
    import pandas

    x, y, by = axes
    frame = frame.assign(**{name: binned(frame[name]) for name in (x, y) if name})
    kinds = sorted(frame[by].unique())[:6] if by else [None]
    figure, shown = panels(1, len(kinds), 1.2 + 5.2 * len(kinds), 4.6, sharey=True)
    numbers = frame[value].astype(float)
    low, high = (0.0, 1.0) if numbers.between(0, 1).all() else (numbers.min(), numbers.max())
    colors = matplotlib.colormaps["cividis"].with_extremes(bad="0.9")
    for one, kind in zip(shown, kinds, strict=True):
        part = frame if kind is None else frame[frame[by] == kind]
        means = pandas.pivot_table(part.assign(**{value: numbers}), value, [y] if y else [], [x])
        image: Any = one.imshow(means, origin="lower", aspect="auto", cmap=colors, vmin=low, vmax=high)
        for axis, labels in ((one.xaxis, means.columns), (one.yaxis, means.index)):
            step = -(-len(labels) // 12)
            names = [f"{label:.3g}" if isinstance(label, float) else str(label) for label in labels[::step]]
            axis.set_ticks(range(0, len(labels), step), names)
        one.set(xlabel=with_unit(x), title=f"{by} {kind}" if by else value)
    shown[0].set_ylabel(with_unit(y))
    figure.colorbar(image, ax=shown, label=value)
    figure.suptitle(f"{title}: mean {value} of {len(frame)} trials", fontsize=11)
    return save(figure, path)


def with_unit(name: str) -> str:
    """A parameter with its unit."""
    return f"{name} ({UNITS[name]})" if name in UNITS else name


def binned(values: pandas.Series) -> pandas.Series:
    """More than 40 different numbers as the lower edges of twelve bins."""
    import pandas

    if values.nunique() <= 40:
        return values
    return pandas.qcut(values, 12, duplicates="drop").map(lambda bin: bin.left).astype(float)
