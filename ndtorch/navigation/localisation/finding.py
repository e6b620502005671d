"""Finding an unknown place in a known map: every place and direction is tried, a little at each step."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.kernels.vote_places import vote_places
from ndtorch.navigation.localisation.params import LocaliserParams
from ndtorch.navigation.localisation.walls import Scan, fit_scan

Floats = npt.NDArray[Any]

NARROW = 0.03
"""Least standard deviation along a distribution that is drawn into the picture, m."""


class Picture(NamedTuple):
    """Known walls, drawn to be looked up.

    Attributes:
        light: `[rows, columns]`, 1 on a wall and less around it.
        left, bottom: of the first pixel's middle, m.
    """

    light: Floats
    left: float
    bottom: float


class Hunt(NamedTuple):
    """State of a search through a known map.

    Attributes:
        pattern: what the car has ranged around itself, as seen from where it was when the search began, `[n, 2]`, m.
        origin: that pose in the frame in which the car drives, `[3]`.
        turn: number of the next direction that is tried; past the last one the best places are refined.
        places: candidates `[k, 4]`: score, x, y, heading in the known map; refined ones are `done`.
        done: refined candidates, `[m, 4]`.
        way: driven since the last search began, m, `[]`.
    """

    pattern: Tensor
    origin: Tensor
    turn: Tensor
    places: Tensor
    done: Tensor
    way: Tensor


def middles(walls: Tensor, params: LocaliserParams) -> tuple[Floats, Floats]:
    """Middles `[k, 2]`, m, and covariances `[k, 2, 2]` of the cells that weigh enough."""
    half = params.size // 2
    at = (walls[..., 0] >= params.least).nonzero()
    sums = walls[at[:, 0], at[:, 1]].double().numpy()
    mean = sums[:, 1:3] / sums[:, :1]
    square = sums[:, [3, 4, 4, 5]].reshape(-1, 2, 2) / sums[:, :1, None]
    spread = square - mean[:, :, None] * mean[:, None, :]
    return (at.numpy() - half + 0.5) * params.cell + mean, spread


def draw(walls: Tensor, params: LocaliserParams) -> Picture:
    """The picture of known walls: a bright line along each distribution, blurred."""
    f = params.finding
    mean, spread = middles(walls, params)
    value, axes = np.linalg.eigh(spread)
    reach = np.sqrt(np.maximum(value[:, 1], NARROW**2))[:, None] * axes[:, :, 1]
    points = (mean[:, None] + np.linspace(-1.5, 1.5, 5)[:, None] * reach[:, None]).reshape(-1, 2)
    border = 4 * f.blur
    left, bottom = points.min(0) - border if len(points) else (0.0, 0.0)
    right, top = points.max(0) + border if len(points) else (0.0, 0.0)
    columns, rows = math.ceil((right - left) / f.pixel) + 1, math.ceil((top - bottom) / f.pixel) + 1
    light, reach_ = np.zeros((rows, columns), np.float32), math.ceil(2.5 * f.blur / f.pixel)
    place = (points - (left, bottom)) / f.pixel
    near = np.rint(place).astype(np.int64)
    for down in range(-reach_, reach_ + 1):
        for across in range(-reach_, reach_ + 1):
            column, row = near[:, 0] + across, near[:, 1] + down
            away = ((column - place[:, 0]) ** 2 + (row - place[:, 1]) ** 2) * f.pixel**2
            good = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
            shine = np.exp(-away / (2 * f.blur**2)).astype(np.float32)
            np.maximum.at(light, (row[good], column[good]), shine[good])
    return Picture(light, float(left), float(bottom))


def no_hunt() -> Hunt:
    """Before the first search."""
    none = torch.zeros(0, 4, dtype=torch.float64)
    number = torch.zeros((), dtype=torch.float64)
    return Hunt(none[:, :2], none.new_zeros(3), number - 1, none, none, number)


def begin(hunt: Hunt, walls: Tensor, pose: tuple[float, float, float], params: LocaliserParams) -> Hunt:
    """Begin a search with what is around the car, if that is enough."""
    f = params.finding
    mean, _ = middles(walls, params)
    x, y, heading = pose
    offset = mean - (x, y)
    offset = offset[np.hypot(*offset.T) < f.around]
    if len(offset) < f.least:
        return hunt._replace(way=hunt.way - f.again)
    cos, sin = math.cos(heading), math.sin(heading)
    pattern = np.stack((cos * offset[:, 0] + sin * offset[:, 1], cos * offset[:, 1] - sin * offset[:, 0]), -1)
    fresh = no_hunt()
    return fresh._replace(
        pattern=torch.from_numpy(pattern),
        origin=torch.tensor(pose, dtype=torch.float64),
        turn=fresh.way,
    )


def vote(hunt: Hunt, picture: Picture, params: LocaliserParams) -> Hunt:
    """Try the next direction at every place; the best few become candidates."""
    f, turn = params.finding, int(hunt.turn)
    heading = 2 * math.pi * turn / f.turns
    cos, sin = math.cos(heading), math.sin(heading)
    px, py = hunt.pattern.numpy().T
    x, y = (cos * px - sin * py) / f.pixel, (sin * px + cos * py) / f.pixel
    rows, columns = picture.light.shape
    out = np.zeros((-(-rows // f.stride), -(-columns // f.stride)), np.float32)
    vote_places(picture.light, x, y, f.stride, out)
    found = []
    for _ in range(f.each):
        i, j = np.unravel_index(int(out.argmax()), out.shape)
        place = (picture.left + j * f.stride * f.pixel, picture.bottom + i * f.stride * f.pixel)
        found.append((float(out[i, j]), *place, heading))
        out[max(0, i - 2) : i + 3, max(0, j - 2) : j + 3] = 0.0
    places = torch.cat((hunt.places, torch.tensor(found, dtype=torch.float64)))
    best = places[:, 0].argsort(descending=True, stable=True)[: f.kept]
    return hunt._replace(places=places[best], turn=hunt.turn + 1)


def refine(hunt: Hunt, known: Tensor, params: LocaliserParams) -> Hunt:
    """Fit the pattern from the best candidate that is left."""
    f = params.finding
    x, y = hunt.pattern.numpy().T
    _, *start = hunt.places[0].tolist()
    scan = Scan(np.ascontiguousarray(x), np.ascontiguousarray(y), np.ones(len(x)))
    fit = fit_scan(known, scan, (start[0], start[1], start[2]), (f.loose, f.loose), params, f.steps)
    made = torch.tensor([[fit.score, fit.x, fit.y, fit.heading]], dtype=torch.float64)
    return hunt._replace(places=hunt.places[1:], done=torch.cat((hunt.done, made)))


def verdict(hunt: Hunt, params: LocaliserParams) -> tuple[float, float, float] | None:
    """The pose at which the pattern was seen, where one candidate is good and all others elsewhere are worse."""
    f, done = params.finding, hunt.done.numpy()
    best = done[done[:, 0].argmax()]
    apart = np.hypot(*(done[:, 1:3] - best[1:3]).T) > f.apart
    turned = np.abs(np.angle(np.exp(1j * (done[:, 3] - best[3])))) > f.turned
    others = done[apart | turned, 0]
    if best[0] < f.good or best[0] - others.max(initial=0.0) < f.better:
        return None
    return float(best[1]), float(best[2]), float(best[3])


def carried_over(
    hunt: Hunt, found: tuple[float, float, float], pose: tuple[float, float, float]
) -> tuple[float, float, float]:
    """The pose now, in the known map: the car has driven on since the pattern was taken."""
    ox, oy, before = hunt.origin.tolist()
    turn = found[2] - before
    cos, sin = math.cos(turn), math.sin(turn)
    dx, dy = pose[0] - ox, pose[1] - oy
    return found[0] + cos * dx - sin * dy, found[1] + sin * dx + cos * dy, pose[2] + turn
