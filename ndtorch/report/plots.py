"""Figures of a run, drawn with matplotlib into PNG files, after [B fig. 8, 10], [C fig. 6]; tracks over time.

Time on the axes of networks counts from the start of second-stage learning, as in the papers; time before is shaded.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.report.summary import words
from ndtorch.report.tracks import TrackRecord
from ndtorch.run.result import Floats, Pixels, RunResult
from ndtorch.vision.features import FEATURES, GROUPS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

    from ndtorch.vision.tuning import TuningCurve


class Style(NamedTuple):
    """One feature's line: color as "#rrggbb", and matplotlib's (offset, on-off lengths in line widths)."""

    color: str
    dashes: Literal["solid"] | tuple[float, tuple[float, ...]]


STYLES: dict[str, Style] = {
    "left": Style("#e69f00", (0, (6, 2))),
    "right": Style("#cc79a7", (0, (3, 1.5))),
    "down": Style("#56b4e9", (0, (6, 2, 1, 2))),
    "up": Style("#666666", (0, (6, 2, 1, 2, 1, 2))),
    "0°": Style("#a5673f", (0, (1, 1))),
    "60°": Style("#999933", (0, (1, 1.8))),
    "120°": Style("#7a68d8", (0, (1, 3))),
    "red": Style("#cc3311", "solid"),
    "green": Style("#009e73", "solid"),
    "blue": Style("#0072b2", "solid"),
}
"""Style of every feature, in the order of `FEATURES`."""
COLORS = {
    "white": "#ffffff",
    "grey": "#888888",
    "black": "#000000",
    "yellow": "#e6c200",
    "cyan": "#00b7c7",
    "magenta": "#c030a0",
}
"""Colors that are no features."""
DPI = 110
MAX_GAIN = 10.0
"""Most that an enhanced image is brightened by."""
TIME_LABEL = "time since learning began (s)"


def color_of(name: str) -> str:
    """The color that stands for the name of a feature or a color in all figures and films, as "#rrggbb"."""
    return STYLES[name].color if name in STYLES else COLORS.get(name, COLORS["grey"])


def save(figure: Figure, path: str | Path) -> Path:
    """Write the figure as PNG and give its path back."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas = FigureCanvasAgg(figure)
    with warnings.catch_warnings():
        # Names of sources may hold characters that the font lacks; they show as boxes.
        warnings.filterwarnings("ignore", "Glyph .* missing from")
        canvas.draw()  # type: ignore[no-untyped-call]  # once, not twice as `savefig`
    pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    Image.fromarray(pixels).save(path, format="png", compress_level=4)
    return Path(path)


def new_figure(result: RunResult, what: str, width: float, height: float) -> Figure:
    """A figure of that size in inches, with a title that says what it shows and what the run found."""
    from matplotlib.figure import Figure

    figure = Figure((width, height), dpi=DPI, layout="constrained")
    names = ", ".join(thing.neuron for thing in result.objects)
    text = (
        f"{result.source.name[-48:]}: {what}\n{len(result.objects)} objects{f' ({names})' if names else ''}, "
        f"{result.verdict}, {result.simulated_seconds:.1f} s{', interrupted' if result.interrupted else ''}"
    )
    figure.suptitle(text, fontsize=11).set_parse_math(False)  # names of files may hold dollar signs
    return figure


def draw_all(result: RunResult, folder: str | Path) -> list[Path]:
    """Write outputs.png, weights.png and frames.png into `folder`, made if missing."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    drawings = (draw_outputs, draw_weights, draw_frames)
    return [draw(result, folder / f"{draw.__name__.removeprefix('draw_')}.png") for draw in drawings]


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
        width, marker = (2.2 if j in bold else 1.0), ("o" if len(times) == 1 else None)
        axes.plot(times, values[:, j], color=color, linestyle=dashes, lw=width, marker=marker, zorder=width)
        if j in bold:
            at = (times[-1], values[-1, j])
            axes.annotate(FEATURES[j], at, (4, 0), textcoords="offset points", va="center", fontsize=8, color=color)
    if len(times) > 1:
        axes.set_xlim(times[0], times[-1])
    if times[0] < 0:
        axes.axvspan(float(times[0]), min(0.0, float(times[-1])), color="0.92", lw=0, zorder=-1)


def draw_outputs(result: RunResult, path: str | Path) -> Path:
    """Second-stage outputs over time, a lane a neuron, all to one scale; owners of objects are bold. [B fig. 8a, 10]"""
    figure = new_figure(result, "outputs of the second stage", 9.6, 6.5)
    # Some thousand are enough; an even stride would hide outputs that flip sign from step to step.
    stride = len(result.outputs.times) // 4096 | 1
    times, samples = result.outputs.times[::stride] - result.model.settle, result.outputs.samples[::stride]
    owners = {thing.index for thing in result.objects}
    # Filters that start leave a spike, which may leave its lane.
    after = samples[times >= min(0.0, float(times[-1]))] if len(times) else samples
    top = 1.08 * max(float(np.abs(after).max(initial=0.0)), 1e-3)
    lanes: list[Axes] = list(figure.subplots(10, 1, sharex=True))
    for j, (name, axes) in enumerate(zip(FEATURES, lanes, strict=True)):
        draw_traces(axes, times, samples, [j], [j] if j in owners else [])
        axes.set(ylim=(-top, top), yticks=[])
        axes.set_ylabel(name, rotation=0, ha="right", va="center", color=STYLES[name].color)
    lanes[-1].set_xlabel(f"{TIME_LABEL}; lanes reach from {-top:.2g} to {top:.2g} (no unit)")
    return save(figure, path)


def draw_weights(result: RunResult, path: str | Path) -> Path:
    """The final 10 x 10 weights beside the table of objects, owners as columns. [B fig. 8d, e]"""
    kept = (
        result.model.table(result.state).rows.mT.float().cpu().numpy()
        if result.objects
        else np.zeros_like(result.final_weights)
    )
    figure = new_figure(result, "weights of the second stage", 13.2, 6.7)
    learned, read = figure.subplots(1, 2)
    top = float(result.final_weights.max()) or 1.0
    for axes, values, most, label in ((learned, result.final_weights, top, "weight"), (read, kept, 1.0, "share")):
        figure.colorbar(draw_matrix(axes, values, most), ax=axes, label=f"{label} (no unit)")
    read.set(xlabel="Each column: the object of this neuron", ylabel="Each row: its share of this feature")
    return save(figure, path)


def draw_matrix(axes: Axes, values: Floats, top: float) -> AxesImage:
    """A 10 x 10 matrix with the names of the features: `values[n, k]` is the weight from neuron k to neuron n. Cells of
    a third of `top` and more show their value.
    """
    picture = axes.imshow(values, cmap="Blues", vmin=0, vmax=top, aspect="auto")
    axes.set_xticks(range(10), FEATURES, rotation=45, fontsize=9)
    axes.set_yticks(range(10), FEATURES, fontsize=9)
    for label in (*axes.get_xticklabels(), *axes.get_yticklabels()):
        label.set_color(STYLES[label.get_text()].color)
    axes.set(xlabel="Each column: weights FROM this neuron", ylabel="Each row: weights TO this neuron")
    for group in GROUPS.values():
        if group.start:
            axes.axhline(group.start - 0.5, color="0.4", lw=1.0)
            axes.axvline(group.start - 0.5, color="0.4", lw=1.0)
    for n, k in np.argwhere((values >= top / 3) & (values > 0)).tolist():
        ink = "white" if values[n, k] > 0.55 * top else "black"
        axes.text(k, n, f"{values[n, k]:.2f}", ha="center", va="center", fontsize=8, color=ink)
    return picture


def draw_frames(result: RunResult, path: str | Path) -> Path:
    """Input and image of visual attention at the clearest moment of every winner, a row a winner. [C fig. 6]"""
    moments = sorted((one.picture for one in result.moments.values()), key=lambda picture: picture.time)
    figure = new_figure(result, "attention" if moments else "attention: no winner", 7.6, 1 + 3.6 * max(len(moments), 1))
    if not moments:
        return save(figure, path)
    for (left, right), moment in zip(figure.subplots(len(moments), 2, squeeze=False), moments, strict=True):
        assert moment.enhanced is not None
        name, (enhanced, gain) = FEATURES[moment.winner], brightened(moment.enhanced)
        left.imshow(moment.frame)
        left.set_title(f"input, {moment.time - result.model.settle:.1f} s into learning", fontsize=9)
        right.imshow(enhanced)
        right.set_title(f"{name}, attended to (shown {gain:.1f}x)", fontsize=9, color=STYLES[name].color)
        for axes in (left, right):
            axes.set(xticks=[], yticks=[])
    return save(figure, path)


def brightened(enhanced: Pixels, largest: float = 255) -> tuple[Pixels, float]:
    """An enhanced image whose brightest pixel has that value, and the factor, 1 to `MAX_GAIN`."""
    gain = max(1.0, min(largest / max(int(enhanced.max()), 1), MAX_GAIN))
    return (enhanced * gain).clip(0, 255).astype(np.uint8), gain


def draw_timeline(result: RunResult, tracks: TrackRecord, path: Path, picture: Pixels | None = None) -> Path:
    """timeline.png: a lane an object, thick where it is in sight, and all paths in the picture."""
    from matplotlib.figure import Figure

    (height, width), count = tracks.size, len(tracks.objects)
    above, below = 1.2 + 0.42 * max(count, 2), min(9.0 * height / width, 7.5) + 0.8
    figure = Figure((10.0, above + below), dpi=100, layout="constrained")
    lanes, where = figure.subplots(2, 1, height_ratios=[above, below])
    lanes.set_facecolor("0.85")  # on which white is seen
    for lane, (number, thing) in enumerate(tracks.objects.items()):
        rows, color = tracks.rows_of(number), color_of(thing.color)
        times, places = tracks.time[rows], tracks.center[rows]
        for part in np.split(times, np.nonzero(np.diff(times) > 0.3)[0] + 1) if rows else ():
            lanes.plot([part[0], part[-1]], [lane, lane], color=color, lw=13, solid_capstyle="butt")
        if rows:
            where.plot(*places.T, color=color, lw=2)
            where.plot(*places[-1], "o", color=color)
            where.annotate(str(number), places[0], color=color, weight="bold", fontsize=12)
    for time in result.cuts:
        lanes.axvline(time, color="0.5", lw=1, ls=":")
    names = [f"{number}: {words(thing)}" for number, thing in tracks.objects.items()]
    lanes.set_yticks(range(count), names)
    end = max([result.simulated_seconds, *tracks.times[-1:]])
    lanes.set(xlim=(0, end), ylim=(max(count, 1) - 0.4, -0.6), xlabel="time (s)")
    lanes.set_title(
        f"{result.source.name}: {count} object{'s' * (count != 1)}", loc="left", fontsize=11
    ).set_parse_math(False)
    if picture is not None:
        where.imshow(picture, extent=(0, width, height, 0), alpha=0.75)
    where.set(xlim=(0, width), ylim=(height, 0), aspect="equal", xlabel="column (pixels)", ylabel="row (pixels)")
    return save(figure, path)


UNITS = {
    "temporal_frequency": "Hz",
    "wavelength": "pixels",
    "direction": "degrees",
    "speed": "pixels a frame",
    "fps": "Hz",
}
"""Of the parameters of tuning curves; time constants are in seconds."""


def draw_tuning(curve: TuningCurve, path: str | Path) -> Path:
    """The response over the first parameter, a line for each value of the second, dots; formulas as lines."""
    from matplotlib.figure import Figure

    names, x = list(curve.axes), curve.axes[next(iter(curve.axes))]
    others = curve.axes[names[1]] if names[1:] else [0.0]
    figure = Figure((7, 4.5), dpi=DPI, layout="constrained")
    axes = figure.add_subplot()
    of = {
        name: values.reshape(len(x), len(others), -1)[..., 0].mT.tolist()
        for name, values in {"": curve.response, **curve.formulas}.items()
    }
    for number, k in enumerate(sorted({round(k * (len(others) - 1) / 5) for k in range(6)})):
        label = f"{names[1]} {others[k]:g}" if names[1:] else "response"
        for (name, lines), look in zip(of.items(), ("o", "-", ":"), strict=False):
            told = (name if number == 0 else None) if name else label
            axes.plot(x, lines[k], look, color=f"C{number}", ms=4, lw=1.2, label=told)
    if min(x) > 0 and max(x) / min(x) > 8:
        axes.set_xscale("log")
    unit = UNITS.get(names[0])
    axes.set(
        xlabel=names[0].replace("_", " ") + (f" ({unit})" if unit else ""), ylabel="response", title=curve.detector
    )
    axes.axhline(0, color="0.8", lw=0.8, zorder=0)
    figure.legend(frameon=False, fontsize=8, loc="outside right upper")
    return save(figure, path)
