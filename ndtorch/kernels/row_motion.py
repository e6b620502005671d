"""How a car moved between two looks, from where both rows show again what was ranged in the first look."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[Any]
Numbers = tuple[float, float, float, float]

NEIGHBOURS = 2
"""Places this near to the best one do not count as another place."""


SLOW = 1e-9
"""Costs bent less than this have no place between pixels."""


LOOSE = (400.0, 60.0, 9.0)
"""Factors of the gate in the first steps: the guess may be some pixels off."""


@jit
def row_motion(
    before: Floats,
    rows: Floats,
    x: Floats,
    y: Floats,
    guess: tuple[float, float],
    rig: Numbers,
    search: tuple[int, int, float, float],
    weighing: tuple[float, float, float, int],
    out: Floats,
) -> None:
    """Fill `out` `[8]`: way and turn, their information (three numbers), how many places fit, the mean of their squared
    errors, in standard deviations, and how many were found.

    Of every point the surroundings in the first rows are searched for around where they should be in the second ones.
    Then Gauss-Newton finds the way along an arc and the turn that explain the columns found, weighted by
    1 / (1 + e^2 / gate)^2 for an error of e standard deviations.

    Args:
        before, rows: of the first and the second look, `[2, W]`, left first.
        x, y: points of the body frame at the first look, m, `[n]`.
        guess: way and turn expected, m and radians.
        rig: baseline, m, focal length and middle column, pixels, and place of the cameras ahead of the body's point, m.
        search: pixels to either side that are compared, and that the place may be off; the mean difference of a match
            at most; it must differ by less than this share of the best one elsewhere.
        weighing: standard deviations of a column and of a disparity, pixels; gate; and steps.
    """
    base, focal, middle, forward = rig
    pixel, blur, gate, steps = weighing
    columns = np.full((len(x), 2), -1.0)
    find_columns(before, rows, x, y, guess, rig, search, columns)
    out[7] = (columns >= 0).sum()
    way, turn = guess
    for step in range(steps):
        dd = dt = tt = gd = gt = squares = 0.0
        count = 0
        cos, sin, ch, sh = math.cos(turn), math.sin(turn), math.cos(turn / 2), math.sin(turn / 2)
        limit = gate * (LOOSE[step] if step < len(LOOSE) else 1.0)
        for k in range(len(x)):
            ax, ay = x[k] - way * ch, y[k] - way * sh
            ahead, left = cos * ax + sin * ay - forward, cos * ay - sin * ax
            if ahead <= 0:
                continue
            ahead_d, left_d = -(cos * ch + sin * sh), sin * ch - cos * sh
            ahead_t = left + way * (cos * sh - sin * ch) / 2
            left_t = -ahead - forward - way * (sin * sh + cos * ch) / 2
            for eye in range(2):
                if columns[k, eye] < 0:
                    continue
                off = base / 2 if eye == 0 else -base / 2
                old, new = (y[k] - off) / (x[k] - forward), (left - off) / ahead
                # What the turn alone does not explain comes from the way, and is as wrong as the range.
                share = abs(focal * (old - new) - focal * turn * (1 + old * old)) * (x[k] - forward) / (focal * base)
                variance = pixel * pixel + (blur * share) ** 2
                by_way = -focal * (left_d - new * ahead_d) / ahead
                by_turn = -focal * (left_t - new * ahead_t) / ahead
                error = columns[k, eye] - (middle - focal * new)
                far = error * error / variance
                weight = 1 / variance / (1 + far / limit) ** 2
                dd += weight * by_way * by_way
                dt += weight * by_way * by_turn
                tt += weight * by_turn * by_turn
                gd += weight * by_way * error
                gt += weight * by_turn * error
                if far < limit:
                    count += 1
                    squares += far
        out[2], out[3], out[4], out[5] = dd, dt, tt, count
        if count < 3:
            break
        size = (dd + 1e-6) * (tt + 1e-6) - dt * dt
        way += min(max((tt * gd - dt * gt) / size, -0.1), 0.1)
        turn += min(max((dd * gt - dt * gd) / size, -0.1), 0.1)
        out[6] = squares / count
    out[0], out[1] = way, turn


@jit
def find_columns(
    before: Floats,
    rows: Floats,
    x: Floats,
    y: Floats,
    guess: tuple[float, float],
    rig: Numbers,
    search: tuple[int, int, float, float],
    columns: Floats,
) -> None:
    """Fill `columns` `[n, 2]` with where either eye sees every point now; -1 where it is not found."""
    base, focal, middle, forward = rig
    half, reach, most, ratio = search
    way, turn = guess
    width, size = rows.shape[1], 2 * half + 1
    cos, sin, tx, ty = math.cos(turn), math.sin(turn), way * math.cos(turn / 2), way * math.sin(turn / 2)
    cost, window = np.empty(2 * reach + 1), np.empty(size)
    for k in range(len(x)):
        ahead = cos * (x[k] - tx) + sin * (y[k] - ty) - forward
        left = cos * (y[k] - ty) - sin * (x[k] - tx)
        if ahead <= 0:
            continue
        for eye in range(2):
            off = base / 2 if eye == 0 else -base / 2
            old = middle - focal * (y[k] - off) / (x[k] - forward)
            first = math.floor(old + 0.5)
            start = math.floor(middle - focal * (left - off) / ahead + first - old + 0.5)
            if min(first, start - reach) < half or max(first, start + reach) >= width - half:
                continue
            mean = 0.0
            for j in range(size):
                window[j] = before[eye, first - half + j]
                mean += window[j]
            mean /= size
            best = 0
            for r in range(2 * reach + 1):
                begin, here, total = start - reach + r - half, 0.0, 0.0
                for j in range(size):
                    here += rows[eye, begin + j]
                here = here / size - mean
                for j in range(size):
                    total += abs(rows[eye, begin + j] - window[j] - here)
                cost[r] = total / size
                if cost[r] < cost[best]:
                    best = r
            if cost[best] > most or best in (0, 2 * reach):
                continue
            second = 1e9
            for r in range(2 * reach + 1):
                if abs(r - best) > NEIGHBOURS:
                    second = min(second, cost[r])
            if cost[best] > ratio * second:
                continue
            curve = cost[best - 1] + cost[best + 1] - 2 * cost[best]
            shift = (cost[best - 1] - cost[best + 1]) / (2 * curve) if curve > SLOW else 0.0
            columns[k, eye] = start - reach + best + min(max(shift, -0.5), 0.5) + old - first
