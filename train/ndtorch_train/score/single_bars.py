"""Sums of a single moving bar, measured once from rendered frames: what random scenes are superposed of.

`ndtorch.score.single_bars` measures them again and writes `single_bars.csv`.
"""

from __future__ import annotations

import csv
import functools
from pathlib import Path

import torch
from torch import Tensor

from ndtorch.scenes import Bar, BarScene
from ndtorch.vision import VisualFeatures

TABLE = Path(__file__).with_name("single_bars.csv")
DIRECTIONS = 16
ORIENTATIONS = 8
LENGTH, WIDTH, SPEED = 50.0, 12.0, 50.0
# The motion filters keep half a second; what is averaged covers every sub-pixel position.
SETTLE, AVERAGED = 200, 40
CANVAS = 320


def direction_degrees(index: int) -> float:
    """Direction of motion number `index`, counter-clockwise from right."""
    return 360 / DIRECTIONS * index


def orientation_degrees(index: int) -> float:
    """Orientation number `index`, counter-clockwise, 0 = long axis vertical."""
    return 180 / ORIENTATIONS * index


def across(direction: int) -> int:
    """The orientation of a bar that moves across its long axis in that direction."""
    return direction % ORIENTATIONS


def measure(direction: int, orientation: int, size: int = CANVAS) -> Tensor:
    """Mean sums of a white bar of steady full brightness, `[10]`, from `AVERAGED` rendered frames."""
    bar = Bar(
        (1.0, 1.0, 1.0),
        direction_degrees(direction),
        (size / 2, size / 2),
        orientation_degrees(orientation),
        SPEED,
        LENGTH,
        WIDTH,
    )
    scene = BarScene([bar], (SETTLE + AVERAGED) / 100, size=(size, size))
    features = VisualFeatures((size, size), exact=False)
    state, kept = None, []
    with torch.inference_mode():
        for n, frames in enumerate(scene.chunks(8)):
            if 8 * (n + 1) <= SETTLE:
                _, _, state = features.motion.scan(frames.mean(-3), state)
            else:
                sums, state = features(frames, state)
                kept.append(sums)
    mean: Tensor = torch.cat(kept).mean(0)
    return mean


@functools.cache
def single_bars() -> Tensor:
    """The measured table, `[DIRECTIONS, ORIENTATIONS, 10]`."""
    table = torch.zeros(DIRECTIONS, ORIENTATIONS, 10)
    with TABLE.open(encoding="utf-8") as file:
        for direction, orientation, *sums in list(csv.reader(file))[1:]:
            table[int(direction), int(orientation)] = torch.tensor([float(value) for value in sums])
    return table


def main() -> None:
    """Measure all bars and write the table."""
    from ndtorch.vision import FEATURES

    torch.set_num_threads(1)
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["direction", "orientation", *FEATURES])
        for direction in range(DIRECTIONS):
            for orientation in range(ORIENTATIONS):
                sums = measure(direction, orientation).tolist()
                writer.writerow([direction, orientation, *(f"{value:.5g}" for value in sums)])
                print(direction, orientation, flush=True)


if __name__ == "__main__":
    main()
