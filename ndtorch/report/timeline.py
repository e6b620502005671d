"""Objects over time: a figure with one lane an object, and JSON lines."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ndtorch.binding import BoundObject
from ndtorch.report.plots.layout import GREY, STYLES
from ndtorch.report.words import numbered, record
from ndtorch.run.result import RunResult
from ndtorch.run.watchers import Pixels, Watcher

Floats = npt.NDArray[np.float64]


class TimelineFile(Watcher):
    """timeline.jsonl: one line an object, written when it is lost, or at the end of the run.

    An object that stays in sight for some thousand detections has a line for each part of its path.

    Args:
        path: the file.
        size: height and width of the frames, pixels.

    Attributes:
        trouble: why nothing was written any more, which does not end the run.
    """

    def __init__(self, path: Path, size: tuple[int, int]) -> None:
        self.path, self.size = path, size
        self.trouble: OSError | None = None
        path.touch()

    def objects(self, things: Sequence[BoundObject]) -> None:
        lines = [json.dumps(record(n, thing, self.size), ensure_ascii=False) + "\n" for n, thing in numbered(things)]
        try:
            if self.trouble is None:
                with self.path.open("a", encoding="utf-8") as file:
                    file.writelines(lines)
        except OSError as error:
            self.trouble = error


def color_of(thing: BoundObject) -> str:
    """Color to draw an object in."""
    return STYLES[thing.color].color if thing.color in STYLES else GREY


def draw_timeline(result: RunResult, path: Path, ground: Pixels | None = None) -> Path:
    """timeline.png: a lane an object in its color, arrows for where it moves, and all paths in the picture."""
    from matplotlib.figure import Figure
    from matplotlib.patheffects import withStroke

    height, width = result.full_size
    count, aspect = len(result.objects), width / height
    # Of a run that was resumed, everything from its very first frame on.
    end = max([result.simulated_seconds, *result.outputs.times[-1:]])
    # Both parts are as wide as the figure: paths can be followed, and lanes can be read on a phone.
    above, below = 1.2 + 0.42 * max(count, 2), min(9.0 / aspect, 7.5) + 0.8
    figure = Figure(figsize=(10.0, above + below), dpi=100, layout="constrained")
    lanes, picture = figure.subplots(2, 1, height_ratios=[above, below])
    for lane, (number, thing) in enumerate(numbered(result.objects)):
        color = color_of(thing)
        times, columns, rows = sightings(thing, result)
        # Out of sight: a thin line; in sight: a thick one.
        lanes.plot([times[0], times[-1]], [lane, lane], color=color, lw=1.5)
        for part in np.split(times, np.nonzero(np.diff(times) > 0.3)[0] + 1):
            lanes.plot([part[0], part[-1]], [lane, lane], color=color, lw=13, solid_capstyle="butt")
        for time, down, right in arrows(times, columns / height, rows / height, max(0.5, end / 40)):
            turn = math.degrees(math.atan2(-down, right))
            lanes.text(time, lane, "→", rotation=turn, color="white", ha="center", va="center", fontsize=11)
        outline = [withStroke(linewidth=4, foreground="white")]
        picture.plot(columns, rows, color=color, lw=2, path_effects=outline)
        k = max(0, len(rows) - max(2, len(rows) // 6))
        picture.annotate(
            "",
            (columns[-1], rows[-1]),
            (columns[k], rows[k]),
            arrowprops={"arrowstyle": "-|>", "color": color, "lw": 0, "mutation_scale": 20},
        )
        picture.plot(columns[0], rows[0], "o", color=color, ms=5)
        side = -1 if lane % 2 else 1  # objects that come one after the other often come in at one place
        gap, edge = 0.015 * height, 0.04 * height
        place = (min(max(float(columns[0]) - gap * side, edge), width - edge), max(float(rows[0]) - gap, 0.07 * height))
        picture.annotate(
            str(number),
            place,
            color=color,
            weight="bold",
            ha="right" if side > 0 else "left",
            va="bottom",
            fontsize=12,
            path_effects=outline,
            zorder=5,
        )
    for time in result.cuts:
        lanes.axvline(time, color="0.5", lw=1, ls=":")
        lanes.text(time, -0.55, " new scene", color="0.4", fontsize=8, va="top")
    names = [f"{n}: {thing.color}, {thing.direction or 'no direction'}" for n, thing in numbered(result.objects)]
    lanes.set_yticks(range(count), names)
    lanes.set_xlim(0, end)
    lanes.set_ylim(max(count, 1) - 0.4, -0.6)
    lanes.set_xlabel("time (s)")
    lanes.set_title(f"{result.source}: {count} object{'' if count == 1 else 's'}", loc="left", fontsize=11)
    if not count:
        lanes.text(0.5, 0.5, "nothing moved", transform=lanes.transAxes, ha="center", color="0.4")
    lanes.spines[["top", "right"]].set_visible(False)
    if ground is not None:
        picture.imshow(ground, extent=(0, width, height, 0), alpha=0.75)
    picture.set(xlim=(0, width), ylim=(height, 0), aspect="equal")
    picture.set(xlabel="column (pixels of the source)", ylabel="row (pixels)")
    picture.set_title("where, in the picture: the number stands where it was first seen", loc="left", fontsize=11)
    if ground is None:
        picture.grid(color="0.93", lw=0.6)
    figure.savefig(path)
    return path


def sightings(thing: BoundObject, result: RunResult) -> tuple[Floats, Floats, Floats]:
    """Times of an object's sightings, and its columns and rows there in pixels of the source, `[n]` each."""
    assert thing.place is not None
    points = np.array(thing.path or [(thing.last_seen or 0.0, *thing.place)])
    places = result.pixel_map.points(points[:, 1:])
    return points[:, 0], places[:, 0], places[:, 1]


def arrows(times: Floats, columns: Floats, rows: Floats, every: float) -> list[tuple[float, float, float]]:
    """Time, and unit vector down and right, of the motion along a path at regular times."""
    out = []
    for time in np.arange(times[0] + every / 2, times[-1], every):
        near = np.nonzero(np.abs(times - time) <= max(every, 0.4))[0]
        if len(near) < 2:
            continue
        down, right = rows[near[-1]] - rows[near[0]], columns[near[-1]] - columns[near[0]]
        size = float(np.hypot(down, right))
        if size > 0.01:
            out.append((float(time), float(down / size), float(right / size)))
    return out
