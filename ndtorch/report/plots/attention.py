"""What attention makes of the input, cropped to the object so that it can be seen. [C fig. 6]"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.report.plots.layout import STYLES, inches, new_figure, save
from ndtorch.run.result import RunResult
from ndtorch.run.watchers import Pixels
from ndtorch.vision.features import FEATURES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Mask = npt.NDArray[np.bool_]

PIXELS = 800
"""Longest side of a frame as it is handed to matplotlib."""
BRIGHT = 0.35
"""Share of the brightest pixel after attention from which on a pixel belongs to the object."""
SMALLEST = 0.2
"""A crop is this share of the frame's sides at least."""
MOST_GAIN = 10.0


class Box(NamedTuple):
    """Part of a frame: the first row and column, and those after the last."""

    top: int
    left: int
    bottom: int
    right: int

    def of(self, pixels: Pixels) -> Pixels:
        """That part of an image."""
        return pixels[self.top : self.bottom, self.left : self.right]


def draw_frames(result: RunResult, path: str | Path) -> Path:
    """Where the winner's object is in the input, and the object before and after attention, larger, a row a winner."""
    moments = sorted(result.moments.values(), key=lambda moment: moment.time)
    if not moments:
        figure = new_figure(result, "attention", 7.6, 2.4)
        words = "No object won the model's attention in this run."
        figure.text(0.5, 0.35, words, ha="center", va="center", fontsize=12, color="0.35")
        return save(figure, path)
    side, gap = 3.0 if len(moments) <= 4 else 2.2, 0.25
    width, step = 3 * side + 4 * gap, side + 0.62
    height = 0.6 + step * len(moments)
    figure = new_figure(result, "attention", width, height)
    for row, moment in enumerate(moments):
        name = FEATURES[moment.neuron]
        color = STYLES[name].color
        bottom = height - 0.4 - step * (row + 1) + 0.12
        box, parts = object_box(moment.enhanced), object_parts(moment.enhanced)
        enhanced, gain = brightened(moment.enhanced, 255)
        before, after = (stands_out(image, parts) for image in (moment.frame, moment.enhanced))
        titles = (
            f"input, {moment.time - result.settle:.1f} s into learning",
            f"{name}, as it comes\n{times(before)} as bright as anything else",
            f"{name}, attended to (shown {gain:.1f}x)\n{times(after)} as bright as anything else",
        )
        for column, pixels in enumerate((moment.frame, box.of(moment.frame), box.of(enhanced))):
            axes = inches(figure, gap + (side + gap) * column, bottom, side, side)
            show(axes, pixels)
            axes.set_title(titles[column], fontsize=8.5, pad=4)
            if column == 0:
                tall, wide = moment.frame.shape[:2]
                corners = [(box.left, box.top), (box.right, box.top), (box.right, box.bottom), (box.left, box.bottom)]
                across, down = zip(*[*corners, corners[0]], strict=True)
                axes.plot(np.array(across) / wide, np.array(down) / tall, color="white", lw=3)
                axes.plot(np.array(across) / wide, np.array(down) / tall, color=color, lw=1.5)
            else:
                axes.title.set(color=color, weight="bold" if column == 2 else "normal")
                for spine in axes.spines.values():
                    spine.set(color=color, lw=1.5)
    return save(figure, path)


def show(axes: Axes, pixels: Pixels) -> None:
    """An image that fills its axes but for its shape; places in it are shares of its sides."""
    step = max(1, max(pixels.shape[:2]) // PIXELS)
    axes.imshow(pixels[::step, ::step], extent=(0, 1, 1, 0))
    axes.set(xticks=[], yticks=[], xlim=(0, 1), ylim=(1, 0), aspect=pixels.shape[0] / pixels.shape[1])


def object_parts(enhanced: Pixels) -> Mask:
    """What belongs to the object `[H, W]`: all that is `BRIGHT` after attention, and a rim; maybe in two places."""
    import cv2

    light = enhanced.max(-1)
    near = max(3, round(0.02 * max(light.shape)))
    bright = ((light >= BRIGHT * int(light.max())) & (light > 0)).astype(np.uint8)
    parts: Mask = cv2.dilate(bright, np.ones((near, near), np.uint8)).astype(bool)
    return parts


def object_box(enhanced: Pixels) -> Box:
    """Around the strongest connected part of the object, with a margin; of a black image the whole."""
    import cv2

    light = enhanced.max(-1)
    tall, wide = light.shape
    if not light.any():
        return Box(0, 0, tall, wide)
    count, labels = cv2.connectedComponents(object_parts(enhanced).astype(np.uint8))
    sums = np.bincount(labels.ravel(), light.ravel().astype(np.float64), count)
    rows, columns = np.nonzero(labels == 1 + int(sums[1:].argmax()))
    (top, bottom), (left, right) = widened(rows, tall), widened(columns, wide)
    return Box(top, left, bottom, right)


def widened(places: np.ndarray[tuple[int, ...], np.dtype[np.int64]], size: int) -> tuple[int, int]:
    """First and past-last place of a part, with half its length around it, `SMALLEST` at least, inside the frame."""
    first, last = int(places.min()), int(places.max()) + 1
    length = min(size, max(round(2.0 * (last - first)), round(SMALLEST * size), 2))
    start = min(max(0, (first + last - length) // 2), size - length)
    return start, start + length


def stands_out(pixels: Pixels, parts: Mask) -> float:
    """The brightest pixel of the object over the brightest one elsewhere; infinite where all else is black."""
    light = pixels.max(-1)
    inside, outside = int(light[parts].max(initial=0)), int(light[~parts].max(initial=0))
    return inside / outside if outside else float("inf")


def times(ratio: float) -> str:
    """`1.2 times`; above a hundred, or against black, `over 100 times`."""
    return "over 100 times" if ratio > 100 else f"{ratio:.1f} times"


def brightened(enhanced: Pixels, largest: int) -> tuple[Pixels, float]:
    """An enhanced image whose brightest pixel has that value, and the factor, 1 to `MOST_GAIN`."""
    gain = max(1.0, min(largest / max(int(enhanced.max()), 1), MOST_GAIN))
    return (enhanced * gain).clip(0, 255).astype(np.uint8), gain
