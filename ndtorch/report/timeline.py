"""Objects over time: a figure with one lane an object, JSON lines, an overlay video, and words."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding.tracking.detections import Sighting
from ndtorch.binding.tracking.tracks import ObjectFile
from ndtorch.report.palette import STYLES, rgb
from ndtorch.run.video import VideoResult
from ndtorch.scenes.video_writer import VideoWriter

GREY = "#888888"
PATH_HZ = 5.0
"""Places written of every object a second."""
STEP = {"left": (0, -1), "right": (0, 1), "down": (1, 0), "up": (-1, 0)}


def record(number: int, thing: ObjectFile) -> dict[str, Any]:
    """One object as plain data; places are row and column as shares of the picture's height and width."""
    path: list[list[float]] = []
    for time, row, column, _ in thing.path:
        if not path or time - path[-1][0] >= 1 / PATH_HZ - 1e-6:
            path.append([round(time, 3), round(row, 3), round(column, 3)])
    return {
        "object": number,
        "color": thing.color,
        "direction": thing.direction,
        "appeared": round(thing.appeared, 3),
        "disappeared": round(thing.disappeared, 3),
        "neuron": thing.neuron,
        "features": thing.features,
        "path": path,
    }


def write_timeline(result: VideoResult, path: Path) -> None:
    """timeline.jsonl: one line an object, in the order of appearance."""
    lines = [json.dumps(record(n, thing), ensure_ascii=False) for n, thing in enumerate(result.objects, 1)]
    path.write_text("".join(line + "\n" for line in lines), encoding="utf-8")


def summary(result: VideoResult) -> dict[str, Any]:
    """What `--json` prints for ordinary video."""
    return {
        "source": result.source,
        "objects": [record(n, thing) for n, thing in enumerate(result.objects, 1)],
        "weights": result.weights.tolist(),
        "simulated_seconds": result.seconds,
        "wall_seconds": result.wall_seconds,
        "frames_per_second": result.frames / max(result.wall_seconds, 1e-9),
    }


def in_words(result: VideoResult) -> str:
    """The timeline as text."""
    lines = [f"{result.source}: {result.seconds:g} s seen in {result.wall_seconds:.1f} s", ""]
    for number, thing in enumerate(result.objects, 1):
        when = f"{thing.appeared:5.1f} - {thing.disappeared:5.1f} s"
        lines.append(f"object {number}: {when}  {thing.color}, moving {thing.direction}")
    if not result.objects:
        lines.append("no objects")
    if result.interrupted:
        lines.append(f"stopped early, after {result.seconds:g} s; what was seen so far is kept")
    return "\n".join(lines)


def color_of(thing: ObjectFile) -> str:
    """Colour to draw an object in."""
    return STYLES[thing.color].color if thing.color in STYLES else GREY


def draw_timeline(result: VideoResult, path: Path) -> Path:
    """timeline.png: a lane an object in its colour, arrows for where it moves, and all paths in the picture."""
    from matplotlib.figure import Figure

    count = len(result.objects)
    figure = Figure(figsize=(10.5, 1.7 + 0.5 * max(count, 2)), dpi=100)
    lanes, picture = figure.subplots(1, 2, width_ratios=[3, 1.25])
    for lane, thing in enumerate(result.objects):
        color = color_of(thing)
        times = np.array([point[0] for point in thing.path])
        # Out of sight: a thin line; in sight: a thick one.
        lanes.plot([times[0], times[-1]], [lane, lane], color=color, lw=1.5)
        for part in np.split(times, np.nonzero(np.diff(times) > 0.3)[0] + 1):
            lanes.plot([part[0], part[-1]], [lane, lane], color=color, lw=13, solid_capstyle="butt")
        for time, down, right in arrows(thing, result.aspect, max(0.5, result.seconds / 40)):
            turn = math.degrees(math.atan2(-down, right))
            lanes.text(time, lane, "→", rotation=turn, color="white", ha="center", va="center", fontsize=11)
        rows = np.array([point[1] for point in thing.path])
        columns = np.array([point[2] for point in thing.path]) * result.aspect
        picture.plot(columns, rows, color=color, lw=2)
        k = max(0, len(rows) - max(2, len(rows) // 6))
        picture.annotate(
            "",
            (columns[-1], rows[-1]),
            (columns[k], rows[k]),
            arrowprops={"arrowstyle": "-|>", "color": color, "lw": 2},
        )
        picture.annotate(str(lane + 1), (columns[0], rows[0]), color=color, weight="bold", ha="right", va="bottom")
    names = [f"{n}: {thing.color}, {thing.direction}" for n, thing in enumerate(result.objects, 1)]
    lanes.set_yticks(range(count), names)
    lanes.set_xlim(0, result.seconds)
    lanes.set_ylim(max(count, 1) - 0.4, -0.6)
    lanes.set_xlabel("time (s)")
    lanes.set_title(f"{result.source}: {count} object{'' if count == 1 else 's'}", loc="left", fontsize=11)
    if not count:
        lanes.text(0.5, 0.5, "nothing moved", transform=lanes.transAxes, ha="center", color="0.4")
    lanes.spines[["top", "right"]].set_visible(False)
    picture.set(xlim=(0, result.aspect), ylim=(1, 0), aspect="equal", xticks=[], yticks=[])
    picture.set_title("where, in the picture", fontsize=10)
    figure.tight_layout()
    figure.savefig(path)
    return path


def arrows(thing: ObjectFile, aspect: float, every: float) -> list[tuple[float, float, float]]:
    """Time, and unit vector down and right, of the motion along the path at regular times."""
    points = np.array([(t, row, column * aspect) for t, row, column, _ in thing.path])
    out = []
    for time in np.arange(points[0, 0] + every / 2, points[-1, 0], every):
        around = points[np.abs(points[:, 0] - time) <= max(every, 0.4)]
        if len(around) < 2:
            continue
        down, right = around[-1, 1:] - around[0, 1:]
        size = float(np.hypot(down, right))
        if size > 0.01:
            out.append((float(time), float(down / size), float(right / size)))
    return out


class Overlay:
    """overlay.mp4: the video with every object marked that has been in sight long enough to stand."""

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        self.size = (size[0] // 2 * 2, size[1] // 2 * 2)
        self.writer = VideoWriter(path, fps, self.size)

    def picture(self, frame: Tensor, time: float, in_sight: list[tuple[ObjectFile, Sighting]]) -> None:
        """Mark the objects in one frame."""
        import cv2

        height, width = self.size
        image = np.ascontiguousarray(frame[:, :height, :width].permute(1, 2, 0).cpu().numpy())
        for thing, sight in in_sight:
            # A thing has to last a moment before it is one.
            if time - thing.appeared < 0.3:
                continue
            color = rgb(thing.color) if thing.color in STYLES else (136, 136, 136)
            row, column = round(sight.place[0] * height), round(sight.place[1] * width)
            radius = round(0.08 * height * max(1.0, len(sight.fields) ** 0.5 / 2))
            cv2.circle(image, (column, row), radius, (255, 255, 255), 4, cv2.LINE_AA)
            cv2.circle(image, (column, row), radius, color, 2, cv2.LINE_AA)
            down, right = STEP[thing.direction]
            tip = (column + right * 2 * radius, row + down * 2 * radius)
            cv2.arrowedLine(image, (column, row), tip, (255, 255, 255), 4, cv2.LINE_AA, tipLength=0.35)
            cv2.arrowedLine(image, (column, row), tip, color, 2, cv2.LINE_AA, tipLength=0.35)
        self.writer.write(torch.from_numpy(image).permute(2, 0, 1))

    def close(self) -> None:
        """Finish the file."""
        self.writer.close()
