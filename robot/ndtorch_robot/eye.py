"""What one camera shows, in a few numbers: is there a picture, is it sharp, has it moved?

Everything is taken from the pixels that navigation reads, in one color, as means of blocks of four pixels: a mean of
many pixels has little noise. All figures are in levels of 255.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError
from ndtorch.navigation import Strips

Floats = npt.NDArray[np.float32]

BLOCK = 4
"""Pixels of a block; those of the subfield are as many rows high."""


@dataclass(frozen=True)
class SightLimits:
    """When a camera counts as blind, stuck or wrongly mounted. Levels are those of 255.

    Args:
        patience_s: a picture must look wrong for so long, s.
        row_contrast, field_contrast: standard deviation of the block means, less what varies slowly, below which the
            row, or the subfield, shows nothing. A camera is blind when both show nothing.
        row_relative, field_relative: the same as a share of the mean brightness: below it lies fog.
        sharpness: largest change over two pixels of the row, as a share of the row's range, below which it is blurred.
        noise: root mean square step from pixel to pixel of the row from which it is noise, where neighbours are also as
            different as pixels far apart.
        sharp_range: range of a row below which its sharpness is not judged.
        moved_m, turned_rad: how far the car must have driven or turned before its picture must have changed.
        row_change, field_change: root mean square change of the block means below which nothing has changed.
        still: correlation of pictures a third of a second apart below which they have moved although the wheels stand.
        swapped: how much better, as a correlation, the rows must fit with near things on the wrong side.
        mirrored: how much better they must fit when one is mirrored.
        agreement_patches: so many patches of the row must have been compared before.
        agreement_s: seconds over which they are averaged.
    """

    patience_s: float = 0.25
    row_contrast: float = 1.2
    field_contrast: float = 0.6
    row_relative: float = 0.05
    field_relative: float = 0.012
    sharpness: float = 0.2
    noise: float = 10.0
    sharp_range: float = 20.0
    moved_m: float = 0.04
    turned_rad: float = 0.05
    row_change: float = 1.0
    field_change: float = 0.45
    still: float = 0.5
    swapped: float = 0.03
    mirrored: float = 0.1
    agreement_patches: float = 20.0
    agreement_s: float = 2.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value < 1e6:
                raise InputError(f"{name} must be a number of 0 or more, got {value}")


class Eye(NamedTuple):
    """One picture.

    Attributes:
        pixels: the row, `[W]`, levels of 255.
        row: means of its blocks, `[W / 4]`.
        field: means of the blocks of the subfield, `[h / 4, w / 4]`.
        row_shape, field_shape: the same less what varies slowly, such as the shade of a hand.
    """

    pixels: Floats
    row: Floats
    field: Floats
    row_shape: Floats
    field_shape: Floats


def look(strips: Strips) -> Eye:
    """What is seen: one color, green of three."""
    row, field = one_color(strips.row)[0], one_color(strips.field)
    columns = len(row) // BLOCK
    row_means = row[: columns * BLOCK].reshape(columns, BLOCK).mean(1, dtype=np.float32)
    high, wide = field.shape[0] // BLOCK, field.shape[1] // BLOCK
    blocks = field[: high * BLOCK, : wide * BLOCK].reshape(high, BLOCK, wide, BLOCK)
    field_means = blocks.mean((1, 3), dtype=np.float32)
    scale = np.float32(255) if row.dtype.kind == "f" else np.float32(1)
    row_means, field_means = row_means * scale, field_means * scale
    pixels = np.asarray(row, np.float32) * scale
    return Eye(pixels, row_means, field_means, shape(row_means, 8), shape(field_means, 4))


def one_color(part: object) -> npt.NDArray[np.generic]:
    """`[h, w]` of `[..., C, h, w]`."""
    image = np.asarray(part)
    while image.ndim > 3:
        image = image[-1]
    chosen: npt.NDArray[np.generic] = image[image.shape[0] // 2]
    return chosen


def shape(means: Floats, lag: int) -> Floats:
    """Less the mean of the neighbours `lag` blocks to both sides: a linear shade leaves nothing."""
    lag = min(lag, (means.shape[-1] - 1) // 4)
    if lag < 1:
        return means - means.mean() if means.size else np.zeros(1, np.float32)
    shaped: Floats = means[..., lag:-lag] - np.float32(0.5) * (means[..., : -2 * lag] + means[..., 2 * lag :])
    return shaped


def blindness(eye: Eye, limits: SightLimits) -> str | None:
    """Why nothing can be seen in a picture, in words; None when something can."""
    row, field = spread(eye.row_shape), spread(eye.field_shape)
    level, floor = float(eye.row.mean()), float(eye.field.mean()) if eye.field.size else 0.0
    shown = row >= max(limits.row_contrast, limits.row_relative * level)
    if not shown and field < max(limits.field_contrast, limits.field_relative * floor):
        return f"shows nothing: contrast {row:.1f} at level {level:.0f} of 255"
    if shown:
        steps = eye.pixels[1:] - eye.pixels[:-1]
        rough = float(steps @ steps) / max(1, steps.size)
        if rough > limits.noise**2 and rough > spread(eye.pixels) ** 2:
            return f"shows noise: neighbouring pixels differ by {rough**0.5:.0f} levels"
        # Sharp edges of the row: between the 2nd and the 98th percentile of 160 means lies its range.
        ordered = np.sort(eye.row)
        cut = len(ordered) // 50
        extent = float(ordered[-1 - cut] - ordered[cut])
        if extent >= limits.sharp_range:
            step = float(np.abs(eye.pixels[2:] - eye.pixels[:-2]).max())
            if step < limits.sharpness * extent:
                return f"is blurred: no edge of its row is steeper than {100 * step / extent:.0f} % of its range"
    return None


def spread(values: Floats) -> float:
    """Standard deviation."""
    if not values.size:
        return 0.0
    flat = values.ravel() - values.mean()
    return float(np.sqrt(flat @ flat / flat.size))


def change(now: Floats, before: Floats) -> float:
    """Root mean square change of block means, whatever the light does to all of them."""
    return spread(now - before)


def likeness(now: Floats, before: Floats) -> float:
    """Correlation of two pictures less what varies slowly; 1 where there is nothing to compare."""
    a, b = now.ravel(), before.ravel()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > len(a) else 1.0
