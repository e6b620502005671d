"""What one camera shows, reduced to a few numbers, and whether it is blank, noise or blurred.

All numbers come from the pixels that navigation reads, in one color, and from means over blocks of four pixels, which
have little noise. Levels are those of 255.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.navigation import Strips
from ndtorch_robot.camera_monitor._kernels import BLOCK, image_statistics, sd_of_change
from ndtorch_robot.camera_monitor.limits import CameraLimits
from ndtorch_robot.faults import Fault, FaultKind

Floats = npt.NDArray[np.float32]

LOW_CONTRAST = 3.2
"""A subfield has low contrast below this multiple of the limit."""

LOW_TEXTURE, NO_TEXTURE = 0.1, 0.03
"""Texture of a subfield (see `texture`) below which the floor may be, and certainly is, blurred."""

MIN_RANGE_RATIO = 0.8
"""Ratio of `min_range_levels` from which the row over a floor without texture is judged, after its noise is
subtracted."""

BORDER, BORDER_SHARE = 0.5, 50
"""A border crosses the subfield where one of 50 blocks changes by half of the range over two blocks down. A border
blurred by 14 pixels changes by 0.23; of 2448 blurred images, at four light levels, none had more than 0.37."""

FLANK = 0.25
"""A step of the row lies between plateaus where the four blocks on either side change by at most this ratio of it.
Those of an edge blurred by 14 pixels change by more than 0.85."""

FIELD_NOISE, EDGE_NOISE = 1.5 / BLOCK**2, 2 / BLOCK * 2.7**2
"""What noise of variance 1 adds to the square of a subfield's contrast, and to that of the largest of 160 steps between
blocks of the row, which is 2.7 standard deviations on average."""


class ImageStatistics(NamedTuple):
    """Statistics of an image, in levels of 255.

    Attributes:
        row_mean, field_mean: mean of the row, and of the subfield.
        row_contrast, field_contrast: standard deviation of their block means without shading.
        row_step_power: mean square step from pixel to pixel of the row.
        row_sd: standard deviation of the pixels of the row.
        row_range: between the 2nd and the 98th percentile of its block means.
        row_max_step: largest step over two pixels of the row.
    """

    row_mean: float
    field_mean: float
    row_contrast: float
    field_contrast: float
    row_step_power: float
    row_sd: float
    row_range: float
    row_max_step: float


class Snapshot(NamedTuple):
    """One image in block means.

    Attributes:
        row: of the horizon row, `[W / 4]`, levels of 255.
        field: of the subfield, `[h / 4, w / 4]`.
        row_detail, field_detail: the same without shading, such as that of a hand before the lens.
        statistics: of the image.
    """

    row: Floats
    field: Floats
    row_detail: Floats
    field_detail: Floats
    statistics: ImageStatistics


def measure(strips: Strips) -> Snapshot:
    """The snapshot of the strips of one camera, `[..., C, h, w]` each, uint8 or float in 0..1; green of three."""
    row, field = one_color(strips.row), one_color(strips.field)
    scale = 255.0 if row.dtype.kind == "f" else 1.0
    # One dtype and layout for all cameras, so that one kernel is compiled.
    pixels = (np.ascontiguousarray(part, np.float32) for part in (row[:1], field))
    means, blocks, row_detail, field_detail, *statistics = image_statistics(*pixels, scale)
    return Snapshot(means[0], blocks, row_detail[0], field_detail, ImageStatistics(*statistics))


def one_color(part: object) -> npt.NDArray[np.generic]:
    image = part.numpy() if isinstance(part, Tensor) and part.is_cpu else np.asarray(part)
    while image.ndim > 3:
        image = image[-1]
    chosen: npt.NDArray[np.generic] = image[image.shape[0] // 2]
    return chosen


def check_image(image: Snapshot, limits: CameraLimits) -> Fault | None:
    """Why nothing can be recognised in an image; None where something can."""
    seen = image.statistics
    row_shows = seen.row_contrast >= max(limits.row_contrast_levels, limits.row_contrast_ratio * seen.row_mean)
    min_contrast = max(limits.field_contrast_levels, limits.field_contrast_ratio * seen.field_mean)
    if not row_shows and seen.field_contrast < min_contrast:
        words = f"shows nothing: contrast {seen.row_contrast:.1f} at level {seen.row_mean:.0f} of 255"
        return Fault(FaultKind.BLANK, words)
    if row_shows and seen.row_step_power > limits.noise_levels**2 and seen.row_step_power > seen.row_sd**2:
        words = f"shows noise: neighbouring pixels differ by {seen.row_step_power**0.5:.0f} levels"
        return Fault(FaultKind.NOISE, words)
    return check_blur(image, row_shows, min_contrast, limits)


def check_blur(image: Snapshot, row_shows: bool, min_contrast: float, limits: CameraLimits) -> Fault | None:
    """Whether the steepest edge of the row is too soft for its range.

    A smooth wall may fill the row of a good camera. Then the floor has contrast or texture, or the wall ends.
    """
    seen = image.statistics
    sharp = seen.row_range < limits.min_range_levels or seen.row_max_step >= limits.sharpness_ratio * seen.row_range
    low_contrast = seen.field_contrast < LOW_CONTRAST * min_contrast and not has_border(image, limits)
    noise = seen.row_step_power / 2
    plain_floor = row_shows and seen.field_contrast**2 - FIELD_NOISE * noise < min_contrast**2
    if not sharp and (row_shows or (low_contrast and texture(image) < LOW_TEXTURE)):
        steepest = seen.row_max_step
    elif plain_floor or (low_contrast and seen.row_range >= MIN_RANGE_RATIO * limits.min_range_levels):
        # Noise has edges as steep as those of a dark image or of a wall of few shades: it is subtracted.
        steepest = float(np.abs(image.row[2:] - image.row[:-2]).max(initial=0))
        steepest = math.sqrt(max(steepest**2 - EDGE_NOISE * noise, 0))
        if steepest >= limits.soft_edge_ratio * seen.row_range or not (plain_floor or texture(image) < NO_TEXTURE):
            return None
    else:
        return None
    if has_plateaus(image, limits):
        return None
    share = 100 * steepest / seen.row_range
    return Fault(FaultKind.BLURRED, f"is blurred: no edge of its row is steeper than {share:.0f} % of its range")


def texture(image: Snapshot) -> float:
    """Second difference of the subfield's blocks as a ratio to their standard deviation, noise subtracted from both."""
    blocks = image.field
    if blocks.shape[1] < 3:
        return 1.0
    noise = image.statistics.row_step_power / 2 / BLOCK**2
    bend = float(np.mean((blocks[:, 2:] - 2 * blocks[:, 1:-1] + blocks[:, :-2]) ** 2)) - 6 * noise
    return math.sqrt(max(bend, 0) / max(float(blocks.var()) - noise, 1e-6))


def has_plateaus(image: Snapshot, limits: CameraLimits) -> bool:
    """Whether a step between two plateaus, too steep for a blurred image, crosses the row."""
    row, last = image.row, len(image.row) - 6
    if last < 5:
        return False
    before, after = row[4:last], row[6 : last + 2]
    step = np.abs(after - before)
    flanks = [row[k : last - 4 + k] - before for k in (0, 2)] + [row[k : last - 4 + k] - after for k in (8, 10)]
    noise = math.sqrt(EDGE_NOISE * image.statistics.row_step_power / 2)
    steep = step >= limits.min_range_levels / 2 + 2 * noise
    return bool((steep & (np.abs(flanks).max(axis=0) <= FLANK * step)).any())


def has_border(image: Snapshot, limits: CameraLimits) -> bool:
    """Whether an edge too steep for a blurred image crosses the subfield, as between a wall and the floor."""
    rows = image.field
    if len(rows) < 3 or not rows.size:
        return False
    levels, steps = np.sort(rows, None), np.sort(np.abs(rows[2:] - rows[:-2]), None)
    cut = levels.size // BORDER_SHARE
    extent = float(levels[-1 - cut] - levels[cut])
    return extent >= limits.min_range_levels and float(steps[-1 - steps.size // BORDER_SHARE]) >= BORDER * extent


def change(now: Floats, before: Floats) -> float:
    """Standard deviation of the change of block means; a common change of light is none."""
    return float(sd_of_change(now, before))


def correlation(now: Floats, before: Floats, nothing: float = 1.0) -> float:
    """Correlation of two images without shading; `nothing` where there is nothing to compare."""
    a, b = now.ravel(), before.ravel()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > len(a) else nothing


def has_moved(now: Floats, before: Floats, limit: float) -> bool:
    """Whether a row has moved, and three quarters of it by themselves: who passes a stationary car covers fewer."""
    quarters = zip(np.array_split(now, 4), np.array_split(before, 4), strict=True)
    moved = [correlation(*part, nothing=-1.0) < limit for part in quarters]
    return correlation(now, before) < limit and sum(moved) >= 3
