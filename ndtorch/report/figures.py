"""The pictures of one binding run, drawn with matplotlib into PNG files, after [B fig. 8, 10], [C fig. 6].

Time on every axis counts from the start of second-stage learning, as in the papers; time before is shaded.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ndtorch.report.palette import STYLES
from ndtorch.report.panels import add_legend, draw_matrix, draw_traces, inches, new_figure, save
from ndtorch.run.result import RunResult
from ndtorch.run.watchers import Pixels
from ndtorch.vision.features import FEATURES

PIXELS = 800
"""Longest side of a frame as it is handed to matplotlib."""
COLUMNS_SHOWN = 4
"""Panels of weights over time where nobody owns an object."""
TIME_LABEL = "time since learning began (s)"


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


def brightened(enhanced: Pixels, largest: int) -> tuple[Pixels, float]:
    """An enhanced image as bright as the input at its brightest, and the factor, 1 (for nearly 1) to 10."""
    gain = min(largest / max(int(enhanced.max()), 1), 10.0)
    if gain < 1.5:
        return enhanced, 1.0
    return (enhanced * gain).clip(0, 255).astype(np.uint8), gain
