"""What one camera shows, in a few numbers: is there a picture, is it sharp, has it moved?

Everything is taken from the pixels that navigation reads, in one color, as means of blocks of four pixels: a mean of
many pixels has little noise. All figures are in levels of 255.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.kernels.change import change as change_kernel
from ndtorch.kernels.glance import BLOCK, TAIL, glance
from ndtorch.kernels.switch import switched_on
from ndtorch.navigation import Strips
from ndtorch_robot.trouble import Kind, Wrong

Floats = npt.NDArray[np.float32]

LAGS = (8, 4)
"""Blocks of the row, and of the subfield, over which a shade counts as slow."""

HARDLY = 3.2
"""A subfield whose contrast is less than so many times the limit shows little."""

GRAIN, NO_GRAIN = 0.1, 0.03
"""Second difference of a subfield's blocks, as a share of their spread, below which floor has no grain, and none for
sure: blurred."""

SHADES = 0.8
"""Share of `sharp_range` from which the row of a floor without any grain is judged, less what noise makes of it."""

BORDER, FEW = 0.5, 50
"""Change over two blocks down the subfield, as a share of its range, from which a border crosses it, where one of so
many blocks has it. Blurred by 14 pixels a step leaves .23; of 2448 blurred pictures, at four lights, none had more than
.37."""

FIELD_NOISE, EDGE_NOISE = 1.5 / BLOCK**2, 2 / BLOCK * 2.7**2
"""What noise of variance 1 adds to the square of a subfield's contrast, and to that of a row's largest change between
blocks: of 160 such changes the largest is 2.7 standard deviations on average."""


@dataclass(frozen=True)
class SightLimits:
    """When a camera counts as blind, stuck or wrongly mounted. Levels are those of 255.

    Args:
        patience_s: a picture must look wrong for so long, s. One that has not changed where it must: twice.
        row_contrast, field_contrast: standard deviation of the block means, less what varies slowly, below which the
            row, or the subfield, shows nothing. A camera is blind when both show nothing.
        row_relative, field_relative: the same as a share of the mean brightness: below it lies fog.
        sharpness: largest change over two pixels of the row, as a share of the row's range, below which it is blurred.
        noise: root mean square step from pixel to pixel of the row from which it is noise, where neighbours are also as
            different as pixels far apart.
        sharp_range: range of a row below which its sharpness is not judged.
        softness: where the subfield shows nothing, or little and no grain, largest change over two blocks of the row,
            as a share of its range, below which it is blurred. All are taken less what noise makes of them.
        moved_m, turned_rad: how far the car must have driven or turned before its picture must have changed.
        row_change, field_change: root mean square change of the block means below which nothing has changed.
        still: correlation of pictures a third of a second apart below which they have moved although the wheels stand.
        by_chance: how much better, as a correlation, a patch of a row may fit where it must not lie.
        swapped: sum of what patches fit better than that with near things on the wrong side.
        mirrored: the same where one row is mirrored.
        turns: so many comparisons of pictures from before and after a turn must have been made before.
        backwards: how much better they must fit when turned the wrong way. The natural logarithm of what is left
            unexplained must be less by so much.
    """

    patience_s: float = 0.25
    row_contrast: float = 1.2
    field_contrast: float = 0.6
    row_relative: float = 0.05
    field_relative: float = 0.012
    sharpness: float = 0.2
    noise: float = 10.0
    sharp_range: float = 20.0
    softness: float = 0.36
    moved_m: float = 0.02
    turned_rad: float = 0.025
    row_change: float = 1.0
    field_change: float = 0.45
    still: float = 0.5
    by_chance: float = 0.05
    swapped: float = 8.0
    mirrored: float = 3.0
    turns: float = 3.0
    backwards: float = 0.3

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 <= value < 1e6:
                raise InputError(f"{name} must be a number of 0 or more, got {value}")


def compiled() -> bool:
    """Whether kernels do the work: there are no gradients here, so nobody need be asked but Numba and the switch."""
    return switched_on()


class Figures(NamedTuple):
    """What a picture is judged by, in levels of 255.

    Attributes:
        level, floor: mean of the row, and of the subfield.
        row_spread, field_spread: standard deviation of their shapes.
        rough: mean square step from pixel to pixel of the row.
        spread: standard deviation of its pixels.
        extent: between the 2nd and the 98th percentile of its block means.
        step: largest change over two pixels of the row.
    """

    level: float
    floor: float
    row_spread: float
    field_spread: float
    rough: float
    spread: float
    extent: float
    step: float


class Eye(NamedTuple):
    """One picture.

    Attributes:
        row: means of the blocks of the row, `[W / 4]`, levels of 255.
        field: means of the blocks of the subfield, `[h / 4, w / 4]`.
        row_shape, field_shape: the same less what varies slowly, such as the shade of a hand.
        figures: see there.
    """

    row: Floats
    field: Floats
    row_shape: Floats
    field_shape: Floats
    figures: Figures


def look(strips: Strips) -> Eye:
    """What is seen: one color, green of three."""
    row, field = one_color(strips.row)[0], one_color(strips.field)
    scale = 255.0 if row.dtype.kind == "f" else 1.0
    # One kind of numbers, one after the other, whatever the camera gives: one kernel is compiled.
    pixels, levels = np.ascontiguousarray(row, np.float32), np.ascontiguousarray(field, np.float32)
    high, wide, columns = levels.shape[0] // BLOCK, levels.shape[1] // BLOCK, len(pixels) // BLOCK
    lag, side = min(LAGS[0], (columns - 1) // 4), min(LAGS[1], (wide - 1) // 4)
    if not (high and min(lag, side) > 0 and compiled()):
        return look_slowly(pixels * np.float32(scale), levels * np.float32(scale))
    row_means, field_means = np.empty(columns, np.float32), np.empty((high, wide), np.float32)
    row_shape, field_shape = np.empty(columns - 2 * lag, np.float32), np.empty((high, wide - 2 * side), np.float32)
    figures = glance(pixels, levels, scale, row_means, field_means, row_shape, field_shape)
    return Eye(row_means, field_means, row_shape, field_shape, Figures(*figures))


def look_slowly(pixels: Floats, levels: Floats) -> Eye:
    """The same without Numba."""
    columns, high, wide = len(pixels) // BLOCK, levels.shape[0] // BLOCK, levels.shape[1] // BLOCK
    row = pixels[: columns * BLOCK].reshape(columns, BLOCK).mean(1)
    field = levels[: high * BLOCK, : wide * BLOCK].reshape(high, BLOCK, wide, BLOCK).mean((1, 3))
    shapes = shape(row, LAGS[0]), shape(field, LAGS[1])
    steps, cut, ordered = pixels[1:] - pixels[:-1], columns // TAIL, np.sort(row)
    figures = Figures(
        level=float(row.mean()) if columns else 0.0,
        floor=float(field.mean()) if field.size else 0.0,
        row_spread=spread(shapes[0]),
        field_spread=spread(shapes[1]),
        rough=float(steps @ steps) / max(1, steps.size),
        spread=spread(pixels),
        extent=float(ordered[-1 - cut] - ordered[cut]) if columns else 0.0,
        step=float(np.abs(pixels[2:] - pixels[:-2]).max(initial=0)),
    )
    return Eye(row, field, *shapes, figures)


def one_color(part: object) -> npt.NDArray[np.generic]:
    """`[h, w]` of `[..., C, h, w]`."""
    # Of a tensor, which is what cameras give, an array is had sooner so.
    image = part.numpy() if isinstance(part, Tensor) and part.is_cpu else np.asarray(part)
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


def blindness(eye: Eye, limits: SightLimits) -> Wrong | None:
    """Why nothing can be seen in a picture; None when something can."""
    seen = eye.figures
    shown = seen.row_spread >= max(limits.row_contrast, limits.row_relative * seen.level)
    if not shown and seen.field_spread < max(limits.field_contrast, limits.field_relative * seen.floor):
        return Wrong(Kind.BLANK, f"shows nothing: contrast {seen.row_spread:.1f} at level {seen.level:.0f} of 255")
    sharp = seen.extent < limits.sharp_range or seen.step >= limits.sharpness * seen.extent
    least = max(limits.field_contrast, limits.field_relative * seen.floor)
    if shown and seen.rough > limits.noise**2 and seen.rough > seen.spread**2:
        return Wrong(Kind.NOISE, f"shows noise: neighbouring pixels differ by {seen.rough**0.5:.0f} levels")
    # A smooth shade may fill the row of a good camera, but then the floor is seen well, or has grain, or the wall ends.
    hardly = seen.field_spread < HARDLY * least and not bordered(eye, limits)
    if not sharp and (shown or (hardly and grain(eye) < GRAIN)):
        return soft(seen.step, seen)
    # Noise has edges as steep as those of a dark picture, or of a wall of few shades. A floor that shows nothing, or no
    # grain at all, is blurred, or nothing is on it.
    noise = seen.rough / 2
    plain = shown and seen.field_spread**2 - FIELD_NOISE * noise < least**2
    if plain or (hardly and seen.extent >= SHADES * limits.sharp_range):
        edge = float(np.abs(eye.row[2:] - eye.row[:-2]).max(initial=0))
        edge = math.sqrt(max(edge**2 - EDGE_NOISE * noise, 0))
        if edge < limits.softness * seen.extent and (plain or grain(eye) < NO_GRAIN):
            return soft(edge, seen)
    return None


def grain(eye: Eye) -> float:
    """How much of what varies in the subfield does so from block to block, less what noise makes of it."""
    blocks = eye.field
    if blocks.shape[1] < 3:
        return 1.0
    noise = eye.figures.rough / 2 / BLOCK**2
    bend = float(np.mean((blocks[:, 2:] - 2 * blocks[:, 1:-1] + blocks[:, :-2]) ** 2)) - 6 * noise
    return math.sqrt(max(bend, 0) / max(float(blocks.var()) - noise, 1e-6))


def bordered(eye: Eye, limits: SightLimits) -> bool:
    """Whether a border crosses the subfield, as that of a wall and the floor, too steep for a blurred picture."""
    rows = eye.field
    if len(rows) < 3 or not rows.size:
        return False
    levels, steps = np.sort(rows, None), np.sort(np.abs(rows[2:] - rows[:-2]), None)
    cut = levels.size // FEW
    extent = float(levels[-1 - cut] - levels[cut])
    return extent >= limits.sharp_range and float(steps[-1 - steps.size // FEW]) >= BORDER * extent


def soft(edge: float, seen: Figures) -> Wrong:
    """What is said of a blurred picture with this steepest edge."""
    share = 100 * edge / seen.extent
    return Wrong(Kind.BLURRED, f"is blurred: no edge of its row is steeper than {share:.0f} % of its range")


def spread(values: Floats) -> float:
    """Standard deviation."""
    if not values.size:
        return 0.0
    flat = values.ravel() - values.mean()
    return float(np.sqrt(flat @ flat / flat.size))


def change(now: Floats, before: Floats) -> float:
    """Root mean square change of block means, whatever the light does to all of them."""
    if now.size and compiled():
        return float(change_kernel(now.ravel(), before.ravel()))
    return spread(now - before)


def likeness(now: Floats, before: Floats) -> float:
    """Correlation of two pictures less what varies slowly; 1 where there is nothing to compare."""
    a, b = now.ravel(), before.ravel()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > len(a) else 1.0


def mixed(field: Tensor) -> bool:
    """Whether pixels of a picture `[..., C, h, w]` differ."""
    return bool((field.amax((-2, -1)) > field.amin((-2, -1))).any())
