"""Kernels of the orientation filters: mirrored margins, spectra of two grids at once, sums of magnitudes."""

from __future__ import annotations

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def mirrored(images: Array, top: int, left: int, padded: Array) -> None:
    """What `torch.nn.functional.pad` does with `mode="reflect"`.

    Args:
        images: `[n, h, w]`.
        top, left: rows above and below, and columns on both sides, fewer than the picture has.
        padded: becomes the pictures with their margins, `[n, h + 2 top, w + 2 left]`.
    """
    count, height, width = images.shape
    for n in range(count):
        for y in range(height + 2 * top):
            at = abs(y - top)
            row, line = images[n, min(at, 2 * height - 2 - at)], padded[n, y]
            line[left : left + width] = row
            for x in range(left):
                line[x] = row[left - x]
                line[left + width + x] = row[width - 2 - x]


@jit
def pair_spectrum(columns: Array, filters: Array, out: Array) -> None:
    """Cut the low rows out of half spectra and multiply them, and their mirror images, with every filter.

    Args:
        columns: spectra of real images, real and imaginary parts last, `[T, N, C / 2 + 1, 2]`.
        filters: real and imaginary parts, `[2, F, R, C]`, of the first grid plus i times that of the second.
        out: conjugates of the products, `[T, F, R, C, 2]`: the real part of a transform of them are the responses on
            the first grid, the imaginary part those on the second, with the other sign.
    """
    _, count, rows, full = filters.shape
    times, length, half, _ = columns.shape
    above = rows - (rows - 1) // 2
    real, imaginary = np.empty(full, columns.dtype), np.empty(full, columns.dtype)
    for t in range(times):
        for r in range(rows):
            place = r if r < above else length - rows + r
            back = rows - r if r else 0
            mirrored = back if back < above else length - rows + back
            here, there = columns[t, place], columns[t, mirrored]
            for c in range(half):
                real[c], imaginary[c] = here[c, 0], here[c, 1]
            for c in range(half, full):
                real[c], imaginary[c] = there[full - c, 0], -there[full - c, 1]
            for f in range(count):
                one, other, to = filters[0, f, r], filters[1, f, r], out[t, f, r]
                for c in range(full):
                    to[c, 0] = real[c] * one[c] - imaginary[c] * other[c]
                    to[c, 1] = -(real[c] * other[c] + imaginary[c] * one[c])


@jit
def pair_sums(responses: Array, weights: Array, sums: Array) -> None:
    """For every image and filter, magnitudes of both grids times the weights of their places, added up.

    Args:
        responses: `[T, F, R, 2 C]`, real and imaginary parts in turn.
        weights: `[R, 2 C]`, of both grids in turn.
        sums: `[T, F]`.
    """
    times, count, height, width = responses.shape
    for t in range(times):
        for f in range(count):
            total = 0.0
            for r in range(height):
                line, shares, part = responses[t, f, r], weights[r], responses.dtype.type(0)
                for c in range(width):
                    part += abs(line[c]) * shares[c]
                total += part
            sums[t, f] = total


@jit
def pair_fields(responses: Array, places: Array, shares: Array, columns: Array, sums: Array) -> None:
    """For every filter and field, magnitudes of both grids times the weights of their places, added up.

    Args:
        responses: `[F, R, 2 C]`, real and imaginary parts in turn.
        places: the two rows of fields to which a row of each grid belongs, `[2, R, 2]`.
        shares: how much, `[2, R, 2]`.
        columns: weights in each column of fields, of the points of each grid, and zero for those of the other,
            `[2, C', 2 C]`.
        sums: `[F, R', C']`.
    """
    count, height, width = responses.shape
    bands = np.empty((2, sums.shape[1], width), responses.dtype)
    for f in range(count):
        bands[:] = 0
        for r in range(height):
            for grid in range(2):
                one, other = places[grid, r, 0], places[grid, r, 1]
                add_magnitudes(responses[f, r], shares[grid, r], bands[grid, one], bands[grid, other])
        for row in range(sums.shape[1]):
            for column in range(sums.shape[2]):
                total = responses.dtype.type(0)
                for grid in range(2):
                    band, weights = bands[grid, row], columns[grid, column]
                    for c in range(width):
                        total += band[c] * weights[c]
                sums[f, row, column] = total


@jit
def add_magnitudes(line: Array, shares: Array, above: Array, below: Array) -> None:
    """Add the magnitudes of a line to two bands."""
    one, other = shares[0], shares[1]
    for c in range(line.shape[0]):
        size = abs(line[c])
        above[c] += one * size
        below[c] += other * size
