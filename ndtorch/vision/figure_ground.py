"""Figure and ground by common fate: two surfaces of dots or texture, each of which moves as a whole.

A Hassenstein-Reichardt detector multiplies what is at a place with what was at its neighbor a moment ago. Summed over
an image, such products are cross-correlations. Their strongest velocity is that of the ground; without its part, the
strongest one left is that of the figure. Each point of contrast goes to the velocity at which its products are larger.
The points of all frames, moved on with the figure, show the outline.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError
from ndtorch.utils.jit import jit

LAGS, SHORT = 12, 4
"""Longest delay of a product, and longest by which the ground is estimated, frames: some dots live for a few only."""
FASTEST, STEP, LEAST_DIFFERENCE = 5.0, 0.125, 0.2
"""Largest speed, grid step, and least difference of figure and ground, pixels a frame."""
REACH, AROUND = 64, 3
"""Largest displacement that is correlated, and radius of a peak, pixels."""
POINTS = 5000
"""Number of points by which velocities are compared."""
SURROUND = 9
"""Side of the window whose mean is subtracted, pixels."""
LEAST_CONTRAST, LEAST_SURVIVAL = 0.4, 0.15
"""Least contrast of a point, and ratio of points that live as long as a delay in use."""
CANDIDATES, WINDOW = 10, 0.42
"""Number of velocities tried for the figure; deviation of the outline's window, distances of moving points."""

Array = npt.NDArray[Any]
Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.float64]


class FigureGround(NamedTuple):
    """What moves apart from the ground.

    Attributes:
        mask: the figure in the last frame, `[H, W]` bool.
        velocity: of the figure, columns and rows a frame.
        ground: velocity of the ground, columns and rows a frame.
        confidence: ratio of the evidence within the mask that is for the figure; around .5 where there is none.
    """

    mask: Bools
    velocity: tuple[float, float]
    ground: tuple[float, float]
    confidence: float


def figure_ground(frames: npt.ArrayLike) -> FigureGround:
    """Segment a short film into a figure and a ground that move apart.

    Args:
        frames: grey values `[T, H, W]`, three frames or more.

    Returns:
        A figure is always chosen; `confidence` says how much evidence there is for it.

    Raises:
        InputError: another shape, fewer frames, fewer than 32 x 32 pixels, or values that are not finite.

    Example:
        >>> dots = (np.random.default_rng(0).random((2, 96, 96)) < 0.05).astype(np.float32)
        >>> film = np.stack([np.roll(dots[0], t, 1) for t in range(8)])  # the ground goes right
        >>> for t in range(8):
        ...     film[t, 30:60, 30 - t : 60 - t] = dots[1, 30:60, 30:60]  # a square goes left
        >>> figure_ground(film).velocity[0] < 0
        True
    """
    film = np.asarray(frames, np.float32)
    if film.ndim != 3 or len(film) < 3 or min(film.shape[1:]) < 32:
        raise InputError(f"frames must be [T, H, W], three of 32x32 pixels at least, got {list(film.shape)}")
    if not np.isfinite(film).all():
        raise InputError("frames must be finite")
    # Frames less the mean around each pixel, -1 to 1, where the contrast of most points is 1.
    images = np.stack([cv2.GaussianBlur(f - cv2.blur(f, (SURROUND, SURROUND)), (0, 0), 0.8) for f in film])
    size = np.abs(images)
    level = float(np.median(size[size > 0.3 * size.max()])) if size.any() else 1.0
    images = np.clip(images / max(level, 1e-12), -1, 1).astype(np.float32)
    lags = np.arange(1, min(LAGS, len(film) - 1) + 1)
    autocorrelation, maps = correlations(images, lags)
    line = np.arange(-FASTEST, FASTEST + 1e-9, STEP)
    grid = np.stack(np.meshgrid(line, line), -1)
    grid = grid[np.linalg.norm(grid, axis=-1) <= FASTEST + 1e-9]

    weights = (lags <= SHORT).astype(float)
    ground = refined(maps, lags, weights, grid[at_velocities(maps, lags, weights, grid).argmax()])
    # Correlation at each delay over that at the first; 0 from where it is small.
    each = [at_velocities(maps[n : n + 1], lags[n : n + 1], np.ones(1), ground[None])[0] for n in range(len(lags))]
    weights = np.clip(np.array(each) / max(float(each[0]), 1e-12), 0, 1)
    weights[np.minimum.accumulate(weights) < LEAST_SURVIVAL] = 0
    weights[0] = 1
    ground = refined(maps, lags, weights, ground)
    residual = maps.copy()
    for image, (x, y) in zip(residual, lags[:, None] * ground, strict=True):
        # Less the peak of the ground, which is that of an image with itself, displaced.
        move = np.array([[1, 0, x], [0, 1, y]], np.float32)
        peak = cv2.warpAffine(autocorrelation, move, autocorrelation.shape[::-1])
        high = peak > 0.3 * peak.max()
        image -= image[high].sum() / max(float(peak[high].sum()), 1e-12) * peak
    grid = grid[np.linalg.norm(grid - ground, axis=-1) > LEAST_DIFFERENCE]
    value = at_velocities(residual, lags, weights, grid)

    size = np.abs(images)
    top = np.stack([cv2.dilate(image, np.ones((3, 3), np.uint8)) for image in size])
    points = np.argwhere((size >= top) & (size > LEAST_CONTRAST))
    some = np.ascontiguousarray(points[:: 1 + len(points) // POINTS])
    base = products(images, some, ground, weights)
    whole = float(np.percentile(base, 75)) if len(base) else 1.0
    # Only points that move with one of the two show the outline.
    moving = len(points) / max(1, len(base)) * float(np.maximum(base, 0).sum())
    window = WINDOW * np.sqrt(images.size / max(1.0, moving))

    def evidence(velocity: Numbers) -> float:
        change = np.clip((products(images, some, velocity, weights) - base) / max(whole, 1e-6), -1, 1)
        outline = pooled(images, some, change, velocity, window)
        return float(outline[strongest_part(outline)].sum())

    tried: list[Numbers] = []
    while len(tried) < CANDIDATES and len(grid):
        tried.append(grid[value.argmax()])
        far = np.linalg.norm(grid - tried[-1], axis=-1) >= 3 * STEP
        grid, value = grid[far], value[far]
    figure = max(tried, key=evidence)
    figure = max((figure, refined(residual, lags, weights, figure)), key=evidence)

    base = products(images, points, ground, weights)
    change = np.clip((products(images, points, figure, weights) - base) / max(whole, 1e-6), -1, 1)
    outline = pooled(images, points, change, figure, window)
    mask = strongest_part(outline)
    total = float(pooled(images, points, np.abs(change), figure, window)[mask].sum())
    confidence = 0.5 + 0.5 * float(outline[mask].sum()) / total if total > 0 else 0.0
    x, y = figure.tolist()
    return FigureGround(mask, (x, y), (float(ground[0]), float(ground[1])), confidence)


def correlations(images: Floats, lags: npt.NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Products of an image with itself, and of frames at every delay, at displacements `[lags, 2 R + 1, 2 R + 1]`."""
    height, width = (cv2.getOptimalDFTSize(side + REACH) for side in images.shape[1:])
    spectrum = np.fft.rfft2(images - images.mean(), (height, width)).astype(np.complex64)
    found = []
    for lag in (0, *lags):
        power = (spectrum[lag:] * spectrum[: len(spectrum) - lag].conj()).mean(0)
        image = np.roll(np.fft.irfft2(power, (height, width)), (REACH, REACH), (0, 1))[: 2 * REACH + 1, : 2 * REACH + 1]
        found.append((image - np.median(image)).astype(np.float32))
    return found[0], np.stack(found[1:])


def at_velocities(maps: Floats, lags: Any, weights: Numbers, velocities: Numbers) -> Numbers:
    """Sum over delays of the correlation at each velocity, `[N]`."""
    total = np.zeros(len(velocities))
    for image, lag, weight in zip(maps, lags, weights, strict=True):
        if weight > 0:
            x, y = (velocities * lag + REACH).astype(np.float32).T
            total += weight * cv2.remap(image, x[None], y[None], cv2.INTER_LINEAR)[0]
    return total


def refined(maps: Floats, lags: Any, weights: Numbers, velocity: Numbers) -> Numbers:
    """A velocity by the centroids of its peaks: dots at whole pixels move by it on average only."""
    offsets = np.stack(np.meshgrid(*2 * [np.arange(-AROUND, AROUND + 1)]), -1)
    for _ in range(4):
        moved, total = np.zeros(2), 0.0
        for image, lag, weight in zip(maps, lags, weights, strict=True):
            column, row = middle = np.rint(velocity * lag).astype(int).clip(AROUND - REACH, REACH - AROUND)
            part = image[row + REACH - AROUND : row + REACH + AROUND + 1, column + REACH - AROUND :][
                :, : 2 * AROUND + 1
            ]
            mass = np.maximum(part - np.median(part), 0)
            if weight > 0 and mass.sum() > 0:
                centroid = middle + (mass[..., None] * offsets).sum((0, 1)) / mass.sum()
                moved += weight * lag * centroid
                total += weight * lag**2
        velocity = moved / total if total > 0 else velocity
    return velocity


@jit
def products(images: Array, points: Array, velocity: Array, weights: Array) -> Array:
    """Weighted mean of the products of each point with where it was and will be at a velocity, `[N]`."""
    count, height, width = images.shape
    found = np.zeros(len(points), np.float32)
    for n in range(len(points)):
        t, row, column = points[n]
        sign = 1.0 if images[t, row, column] > 0 else -1.0
        total, weight = 0.0, 1e-6
        for k in range(-len(weights), len(weights) + 1):
            if k == 0 or weights[abs(k) - 1] == 0 or not 0 <= t + k < count:
                continue
            x, y = column + k * velocity[0], row + k * velocity[1]
            if not (0 <= x <= width - 1 and 0 <= y <= height - 1):
                continue
            i, j = min(int(y), height - 2), min(int(x), width - 2)
            u, v = y - i, x - j
            image = images[t + k]
            above = image[i, j] * (1 - v) + image[i, j + 1] * v
            below = image[i + 1, j] * (1 - v) + image[i + 1, j + 1] * v
            total += weights[abs(k) - 1] * sign * (above * (1 - u) + below * u)
            weight += weights[abs(k) - 1]
        found[n] = total / weight
    return found


def pooled(images: Floats, points: Any, values: Any, velocity: Numbers, window: float) -> Floats:
    """Values of points, moved on to the last frame, in a Gaussian window, `[H, W]`."""
    last, height, width = np.array(images.shape) - (1, 0, 0)
    t, rows, columns = points.T
    i = np.rint(rows + (last - t) * velocity[1]).astype(int)
    j = np.rint(columns + (last - t) * velocity[0]).astype(int)
    inside = (i >= 0) & (i < height) & (j >= 0) & (j < width)
    total = np.bincount(i[inside] * width + j[inside], values[inside], height * width).reshape(height, width)
    return np.asarray(cv2.GaussianBlur(total.astype(np.float32), (0, 0), window))


def strongest_part(evidence: Floats) -> Bools:
    """The connected part of the positive evidence with the largest sum."""
    count, labels = cv2.connectedComponents((evidence > 0).astype(np.uint8))
    sums = np.bincount(labels.ravel(), np.maximum(evidence, 0).ravel(), count)
    return np.asarray(labels == sums.argmax()) & (evidence > 0)
