"""What figures of runs are made of: traces over time, matrices of weights, titles and legends."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ndtorch.report.palette import STYLES
from ndtorch.run.result import Floats, RunResult
from ndtorch.vision.features import FEATURES, GROUPS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

DPI = 110
POINTS = 1200
"""Most points drawn of one trace: about one a pixel."""
MEANING = {
    "stable": "weights stable",
    "learning": "weights still changing",
    "alternating": "ALTERNATING: outputs flip sign from step to step, the weights mean nothing",
    "static": "STATIC: too little fluctuates in view to bind anything",
}
"""What each verdict says, in the words of a title."""


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
        left, right = axes.get_xlim()
        edge = min(0.0, right)
        axes.axvspan(left, edge, color="0.92", lw=0, zorder=-1)
        if edge - left > 0.12 * (right - left):
            place = ((left + edge) / 2, 0.97)
            axes.text(
                *place,
                "settling",
                transform=axes.get_xaxis_transform(),
                ha="center",
                va="top",
                fontsize=8,
                color="0.4",
            )
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


def draw_matrix(axes: Axes, values: Floats, top: float, empty: str = "all weights are zero") -> AxesImage:
    """A 10 x 10 matrix with the names of the features, its groups apart and its large values in the cells.

    Args:
        axes: where to draw.
        values: `[10, 10]`, `values[n, k]` the weight from neuron k to neuron n.
        top: value of the darkest colour; cells of a third of it and more show their value.
        empty: what is written where there is nothing.
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


def inches(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """New axes at a place given in inches from the lower left corner of the figure."""
    across, down = figure.get_size_inches()
    return figure.add_axes((left / across, bottom / down, width / across, height / down))


def new_figure(result: RunResult, what: str, width: float, height: float) -> Figure:
    """A figure of that size in inches, with a title that says what it shows and what the run found."""
    from matplotlib.figure import Figure

    figure = Figure((width, height), dpi=DPI)
    source = result.source if len(result.source) <= 48 else "…" + result.source[-47:]
    names = ", ".join(thing.neuron for thing in result.objects)
    count = len(result.objects)
    duration = f"{result.simulated_seconds:.1f} s"
    found = [
        f"{count} object{'s' * (count != 1)}" + (f" ({names})" if names else ""),
        MEANING[result.verdict],
        f"interrupted after {duration}" if result.interrupted else f"{duration} seen",
    ]
    alarm = result.verdict in ("alternating", "static")
    words = " · ".join(found[1:] if alarm else found)
    # Names of files may hold dollar signs, which are not mathematics.
    for text in (
        figure.text(0.5, 1 - 0.12 / height, f"{source}: {what}", fontsize=12, weight="bold"),
        figure.text(0.5, 1 - 0.36 / height, words, fontsize=9.5, color="#cc3311" if alarm else "0.3"),
    ):
        text.set(ha="center", va="top", parse_math=False)
    return figure


def add_legend(figure: Figure, title: str, bold: Sequence[int]) -> None:
    """The lines of all ten features at the right edge of the figure, group by group."""
    from matplotlib.lines import Line2D

    lines: list[Line2D] = []
    for group, members in GROUPS.items():
        lines.append(Line2D([], [], linestyle="none", label=group))
        for name in FEATURES[members]:
            color, dashes = STYLES[name]
            width = 2.6 if FEATURES.index(name) in bold else 1.4
            lines.append(Line2D([], [], color=color, linestyle=dashes, lw=width, label=name))
    across, down = figure.get_size_inches()
    legend = figure.legend(
        handles=lines,
        title=title,
        title_fontsize=8,
        fontsize=8.5,
        handlelength=3.2,
        loc="upper right",
        bbox_to_anchor=(1 - 0.1 / across, 1 - 0.6 / down),
        frameon=False,
        alignment="left",
    )
    for text in legend.get_texts():
        if text.get_text() in GROUPS:
            text.set(color="0.45", style="italic", x=-30)
        elif FEATURES.index(text.get_text()) in bold:
            text.set_fontweight("bold")


def save(figure: Figure, path: str | Path) -> Path:
    """Write the figure as PNG and give its path back."""
    with warnings.catch_warnings():
        # Names of sources may hold characters that the font lacks; they show as boxes.
        warnings.filterwarnings("ignore", "Glyph .* missing from")
        figure.savefig(path, format="png", pil_kwargs={"compress_level": 4})
    return Path(path)
