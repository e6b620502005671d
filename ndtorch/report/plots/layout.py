"""Colors and line styles of the ten features, and the layout that all plots share."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from ndtorch.run.result import RunResult
from ndtorch.vision.features import FEATURES, GROUPS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Dashes = Literal["solid"] | tuple[float, tuple[float, ...]]


class Style(NamedTuple):
    """One feature's line: color as "#rrggbb", and matplotlib's (offset, on-off lengths in line widths)."""

    color: str
    dashes: Dashes


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

GREY = "#888888"
"""What has no color of its own."""
GREY_RGB = (136, 136, 136)


def rgb(feature: str | int) -> tuple[int, int, int]:
    """Color of a feature, by name or number, as three values in 0..255."""
    name = FEATURES[feature] if isinstance(feature, int) else feature
    red, green, blue = bytes.fromhex(STYLES[name].color[1:])
    return red, green, blue


DPI = 110
TIME_LABEL = "time since learning began (s)"
MEANING = {
    "stable": "weights stable",
    "learning": "weights still changing",
    "alternating": "ALTERNATING: outputs flip sign from step to step, the weights mean nothing",
    "static": "STATIC: too little fluctuates in view to bind anything",
}
"""What each verdict says, in the words of a title."""


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
