"""Single bars as the fields of a grid see them: what scenes for retinotopic signals are superposed of."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.run.progress import progress_bar
from ndtorch.scenes import Bar, BarScene
from ndtorch.vision import GROUPS, VisualFeatures
from ndtorch_train.score.scenes import FPS, SIZE, Scene, moving
from ndtorch_train.score.single_bars import (
    DIRECTIONS,
    LENGTH,
    ORIENTATIONS,
    SPEED,
    WIDTH,
    direction_degrees,
    orientation_degrees,
)

FIELDS = 16
SPACING = SIZE[0] / FIELDS
CANVAS = 350
"""Side of the torus on which single bars are drawn; a bar is not felt further away than half of it."""
STEP = 5
"""Pixels between the offsets at which responses are kept; windows are wider than 60."""
POINTS = CANVAS // STEP
FRAMES = 150
EVERY = 5
"""Samples of 10 ms from one kept to the next: files are updated as often."""


def measure(direction: int, orientation: int, features: VisualFeatures) -> Tensor:
    """What a field sees of a white bar at every offset from its center, `[8, POINTS, POINTS]`.

    Four motions, three orientations, and the bar's area. Rows and columns of offsets run from 0 to the canvas.
    """
    heading, end = math.radians(direction_degrees(direction)), (FRAMES - 1) / FPS
    start = (CANVAS / 2 - SPEED * math.cos(heading) * end, CANVAS / 2 + SPEED * math.sin(heading) * end)
    bar = Bar(
        (1.0, 1.0, 1.0),
        direction_degrees(direction),
        start,
        orientation_degrees(orientation),
        SPEED,
        LENGTH,
        WIDTH,
    )
    scene, state = BarScene([bar], FRAMES / FPS, size=(CANVAS, CANVAS)), None
    for frames in scene.chunks(10):
        _, _, state = features.motion.scan(frames.mean(-3), state)
    assert state is not None
    images = features.images_at(frames[-1], state)[:8].roll((-CANVAS // 2, -CANVAS // 2), (-2, -1))
    # One field of the real width, centered on pixel 0.
    places = (torch.arange(CANVAS) + CANVAS / 2) % CANVAS - CANVAS / 2
    line = torch.where(places.abs() < SPACING, 0.5 + 0.5 * torch.cos(math.pi * places / SPACING), torch.zeros(()))
    window = torch.fft.rfft2(line[:, None] * line)
    seen: Tensor = torch.fft.irfft2(window * torch.fft.rfft2(images).conj(), s=(CANVAS, CANVAS))
    return seen[:, ::STEP, ::STEP].clamp_min(0)


def local_bars(folder: Path) -> Tensor:
    """Responses to all bars, `[DIRECTIONS, ORIENTATIONS, 8, POINTS, POINTS]`; measured once and kept in `folder`."""
    file = folder / f"local_bars_{FIELDS}_{CANVAS}_{STEP}.npy"
    if file.is_file():
        return torch.from_numpy(np.load(file).astype(np.float32))
    table = torch.zeros(DIRECTIONS, ORIENTATIONS, 8, POINTS, POINTS)
    features = VisualFeatures((CANVAS, CANVAS))
    bar = progress_bar(DIRECTIONS * ORIENTATIONS, desc="measuring single bars", unit=" bars", leave=False)
    with torch.inference_mode(), bar:
        for n in range(DIRECTIONS * ORIENTATIONS):
            direction, orientation = divmod(n, ORIENTATIONS)
            table[direction, orientation] = measure(direction, orientation, features)
            bar.update()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        np.save(file, table.numpy())
    except OSError as error:
        raise InputError(f"{file} cannot be written: {error.strerror}") from None
    return table


def local_sums(
    scenes: Sequence[Scene], seconds: float, table: Tensor, chunk: int = 20, every: int = EVERY
) -> Iterator[Tensor]:
    """Signals of all fields, `[B, T, FIELDS, FIELDS, 10]` in chunks of T, a sample every `every` frames.

    Single bars are superposed, which leaves out nothing but that bars cover each other where they cross.
    """
    steps = torch.arange(0, round(seconds * FPS), every)
    for part in torch.split(steps, chunk):
        yield torch.stack([scene_sums(scene, part, table) for scene in scenes])


def scene_sums(scene: Scene, steps: Tensor, table: Tensor) -> Tensor:
    """Signals of one scene at those frame numbers, `[T, FIELDS, FIELDS, 10]`."""
    centers = (torch.arange(FIELDS) + 0.5) * SPACING - 0.5
    total = torch.zeros(len(steps), FIELDS, FIELDS, 10)
    for bar in scene.bars:
        heading = math.radians(direction_degrees(bar.direction))
        seconds = steps / FPS
        columns = bar.start[0] + SPEED * math.cos(heading) * seconds
        rows = bar.start[1] - SPEED * math.sin(heading) * seconds
        seen = at_offsets(table[bar.direction, bar.orientation], rows, columns, centers)
        light = torch.from_numpy(bar.light)
        color = torch.tensor(bar.color)
        grey, twice = color.mean(), moving(light)[steps][:, None, None, None]
        light = light[steps][:, None, None, None]
        for group, gain in zip(GROUPS.values(), (twice * grey**2, light * grey, light * color), strict=True):
            total[..., group] += seen[..., group] * gain
    return total


def at_offsets(responses: Tensor, rows: Tensor, columns: Tensor, centers: Tensor) -> Tensor:
    """Responses `[8, POINTS, POINTS]` at the offsets of a bar from every field, `[T, FIELDS, FIELDS, 8]`."""
    line = responses.permute(1, 2, 0).reshape(-1, responses.shape[0])
    places = []
    for at, length in ((rows, SIZE[0]), (columns, SIZE[1])):
        away = (at[:, None] - centers + length / 2) % length - length / 2
        # Beyond half the canvas nothing is felt.
        within = away.abs() < CANVAS / 2 - STEP
        grid = torch.where(within, away, CANVAS / 2) % CANVAS / STEP
        low = grid.floor()
        share = grid - low
        low = low.long()
        places.append([(low % POINTS, (1 - share) * within), ((low + 1) % POINTS, share * within)])
    total = torch.zeros(len(rows), len(centers), len(centers), responses.shape[0])
    for row, row_share in places[0]:
        for column, column_share in places[1]:
            index = row[:, :, None] * POINTS + column[:, None, :]
            total += line[index] * (row_share[:, :, None] * column_share[:, None, :]).unsqueeze(-1)
    return total
