"""The pictures of one binding run, drawn with matplotlib into PNG files, after [B fig. 8, 10], [C fig. 6].

Time on every axis counts from the start of second-stage learning, as in the papers; time before is shaded.
"""

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
from ndtorch.run.watchers import Pixels
from ndtorch.vision.features import FEATURES, GROUPS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

DPI = 110
POINTS = 1200
"""Most points drawn of one trace: about one a pixel."""
PIXELS = 800
"""Longest side of a frame as it is handed to matplotlib."""
COLUMNS_SHOWN = 4
"""Panels of weights over time where nobody owns an object."""
TIME_LABEL = "time since learning began (s)"
MEANING = {
    "stable": "weights stable",
    "learning": "weights still changing",
    "alternating": "ALTERNATING: outputs flip sign from step to step, the weights mean nothing",
    "static": "STATIC: too little fluctuates in view to bind anything",
}
"""What each verdict says, in the words of a title."""


def draw_all(result: RunResult, folder: str | Path) -> list[Path]:
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


def draw_outputs(result: RunResult, path: str | Path) -> Path:
    """Second-stage outputs over time, one trace a neuron; owners of objects are bold. [B fig. 8a, 10]"""
    figure = new_figure(result, "outputs of the second stage", 9.6, 5.0)
    axes = inches(figure, 0.75, 0.58, 6.95, 3.75)
    owners = [thing.index for thing in result.objects]
    axes.axhline(0, color="0.75", lw=0.8, zorder=0)
    draw_traces(axes, result.outputs.times - result.settle, result.outputs.samples, range(10), owners)
    axes.set_xlabel(TIME_LABEL)
    axes.set_ylabel("output of the neuron")
    add_legend(figure, "neurons (bold:\nowns an object)" if owners else "neurons", owners)
    return save(figure, path)


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
            axes.set_ylabel("weight")
        if place + across >= len(shown):
            axes.set_xlabel(TIME_LABEL)
    features = "bold: feature of\nthe object"
    add_legend(figure, features if things else "no neuron owns\nan object; these\nsend the most", [])
    return save(figure, path)


def draw_frames(result: RunResult, path: str | Path) -> Path:
    """Input beside enhanced image at the clearest moment of every winner, in the order of time. [C fig. 6]"""
    moments = sorted(result.moments.values(), key=lambda moment: moment.time)
    if not moments:
        figure = new_figure(result, "attention", 7.6, 2.4)
        words = "No object won the model's attention in this run."
        figure.text(0.5, 0.35, words, ha="center", va="center", fontsize=12, color="0.35")
        return save(figure, path)
    tall, wide = moments[0].frame.shape[:2]
    most = 3.4 if len(moments) <= 4 else 2.4
    scale = min(3.5 / wide, most / tall)
    across, down = max(scale * wide, 0.4), max(scale * tall, 0.4)
    width, height = 7.7, 0.6 + (down + 0.45) * len(moments)
    figure = new_figure(result, "attention", width, height)
    for row, moment in enumerate(moments):
        name = FEATURES[moment.neuron]
        bottom = height - 0.4 - (down + 0.45) * (row + 1)
        enhanced, gain = brightened(moment.enhanced, int(moment.frame.max()))
        note = f" (shown {gain:.1f}x brighter)" if gain > 1 else ""
        titles = (f"input, {moment.time - result.settle:.1f} s into learning", f"enhanced: {name} wins{note}")
        for column, pixels in enumerate((moment.frame, enhanced)):
            left = width / 2 + (3.7 * column - 1.85) - across / 2
            axes = inches(figure, left, bottom, across, down)
            step = max(1, max(pixels.shape[:2]) // PIXELS)
            axes.imshow(pixels[::step, ::step], aspect="auto")
            axes.set(xticks=[], yticks=[])
            axes.set_title(titles[column], fontsize=10, pad=4)
            if column:
                axes.title.set(color=STYLES[name].color, weight="bold")
    return save(figure, path)


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


def brightened(enhanced: Pixels, largest: int) -> tuple[Pixels, float]:
    """An enhanced image as bright as the input at its brightest, and the factor, 1 (for nearly 1) to 10."""
    gain = min(largest / max(int(enhanced.max()), 1), 10.0)
    if gain < 1.5:
        return enhanced, 1.0
    return (enhanced * gain).clip(0, 255).astype(np.uint8), gain


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
