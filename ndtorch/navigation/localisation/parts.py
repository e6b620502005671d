"""The building in parts of a few metres, which keep their shape and are moved as wholes.

What was seen while the car drove some metres is one part: cells of its own, in a frame of its own. Parts that overlap
are fitted to each other, which gives the edges of a pose graph; the way between them as the odometer tells it gives
the others. When a part is finished and fitted, the graph is relaxed, and the walls are drawn anew.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.kernels.load import kernel
from ndtorch.navigation.localisation.graph import FULL, carried, links_of, relax, seen_from
from ndtorch.navigation.localisation.params import LocaliserParams, PartParams
from ndtorch.navigation.localisation.walls import Scan, empty_walls, fit_scan, pack, unpack
from ndtorch.navigation.localisation.way import Way, no_way, one_way
from ndtorch.navigation.sights import Frames

Floats = npt.NDArray[Any]


class Part(NamedTuple):
    """A finished part.

    Attributes:
        packed: its cells, `[k, 8]`, see `pack`.
        middles: their middles, `[k, 2]`, m.
        points: some of what was ranged, and weights, `[m, 3]`.
        came: from the beginning of the one before it to its own, see `Way`.
    """

    packed: Tensor
    middles: Tensor
    points: Tensor
    came: Way


class Parts(NamedTuple):
    """State of the graph.

    Attributes:
        done: finished parts, K of them.
        poses: of their frames and of that of the one being made, `[K + 1, 3]`.
        begun: steps after which they were begun, `[K + 1]`; one that was left out is not among them.
        cells: of the one being made, `[size, size, 6]`, in its frame.
        points: likewise, `[m, 3]`.
        came: to its beginning from that of the one finished last.
        driven: since it began.
        edges: fits of parts to each other, `[E, 11]`, see `graph`.
        pairs: that are still to be fitted, `[n, 2]`.
        aside: frames of parts that were left out, which move with the finished part that shows most of the same,
            `[n, 5]`: steps after which it was begun, the number of that part, and the pose in its frame.
        scans: likewise, frames of single scans, half a step after each, which move by themselves as long as the way
            since the start will be gone through again.
        learning: parts begun in this time from the start, s, count only where nothing was seen later.
    """

    done: tuple[Part, ...]
    poses: Tensor
    begun: Tensor
    cells: Tensor
    points: Tensor
    came: Way
    driven: Way
    edges: Tensor
    pairs: Tensor
    aside: Tensor
    scans: Tensor
    learning: Tensor


def no_parts(pose: tuple[float, float, float], params: LocaliserParams) -> Parts:
    """Before anything was seen."""
    zeros = torch.zeros(FULL, dtype=torch.float64)
    size = params.parts.size
    return Parts(
        (),
        torch.tensor([pose], dtype=torch.float64),
        zeros[:1],
        torch.zeros(size, size, 6),
        zeros[None, :3][:0],
        no_way(),
        no_way(),
        zeros[None][:0],
        zeros[None, :2][:0],
        zeros[None, :5][:0],
        zeros[None, :5][:0],
        zeros.new_tensor(params.parts.learning),
    )


def left_out(parts: Parts, beside: int) -> Parts:
    """Keep the frame of the part that is being made, which will not be finished, beside a finished one."""
    at = seen_from(parts.poses[beside].numpy(), parts.poses[-1].numpy())
    row = torch.tensor([[float(parts.begun[-1]), beside, *at.tolist()]], dtype=torch.float64)
    scans = parts.scans.clone()
    here = scans[:, 1] == len(parts.done)
    scans[here, 2:] = torch.from_numpy(carried(at, scans[here, 2:].numpy()))
    scans[here, 1] = beside
    return parts._replace(aside=torch.cat((parts.aside, row)), scans=scans)


def with_frame(parts: Parts, pose: tuple[float, float, float], age: Tensor) -> Parts:
    """With a frame for a scan that was seen from a pose of the world."""
    at = seen_from(parts.poses[-1].numpy(), np.array(pose))
    row = torch.tensor([[float(age) + 0.5, len(parts.done), *at.tolist()]], dtype=torch.float64)
    return parts._replace(scans=torch.cat((parts.scans, row)))


def frames_of(parts: Parts) -> Frames:
    """All frames that there have been; their numbers are the steps after which their parts were begun, or the scans."""
    more = torch.cat((parts.aside, parts.scans))
    base, at = parts.poses[more[:, 1].long()].numpy(), more[:, 2:].numpy()
    poses = torch.from_numpy(carried(base, at))
    return Frames(torch.cat((parts.begun, more[:, 0])), torch.cat((parts.poses, poses)))


def add_to_part(parts: Parts, scan: Scan, pose: tuple[float, float, float], params: LocaliserParams) -> Parts:
    """With a scan seen from a pose of the world."""
    x, y, heading = seen_from(parts.poses[-1].numpy(), np.array(pose)).tolist()
    cos, sin, cells = math.cos(heading), math.sin(heading), parts.cells.clone()
    place = (x + cos * scan.x - sin * scan.y, y + sin * scan.x + cos * scan.y)
    kernel("add_points").run(cells.numpy(), *place, scan.weight, params.cell, params.most)
    points = torch.from_numpy(np.stack((*place, scan.weight), -1))
    return parts._replace(cells=cells, points=torch.cat((parts.points, points)))


def begun_at(parts: Parts, pose: tuple[float, float, float], age: Tensor) -> Parts:
    """Begin the part anew at a pose to which the car was carried; what it had so far is left out."""
    here, came = torch.tensor([pose], dtype=torch.float64), no_way()
    if len(parts.done):
        there = seen_from(parts.poses[-2].numpy(), here[0].numpy())
        came = came._replace(pose=torch.from_numpy(there))
        parts = left_out(parts, len(parts.done) - 1)
    else:
        parts = parts._replace(scans=parts.scans[:0])
    return parts._replace(
        poses=torch.cat((parts.poses[:-1], here)),
        begun=torch.cat((parts.begun[:-1], age.reshape(1))),
        cells=torch.zeros_like(parts.cells),
        points=parts.points[:0],
        came=came,
        driven=no_way(),
    )


def finish(parts: Parts, pose: tuple[float, float, float], age: Tensor, dt: float, params: LocaliserParams) -> Parts:
    """End a part at a pose, where the next one begins. One that shows nothing new is left out."""
    p = params.parts
    packed = pack(parts.cells)
    packed = packed[packed[:, 2] >= params.least].double()
    middles = (packed[:, :2] + 0.5) * params.cell + packed[:, 3:5] / packed[:, 2:3]
    overlap, share = overlaps(parts, middles, parts.begun[:-1].numpy() * dt < float(parts.learning), p)
    here, now = torch.tensor([pose], dtype=torch.float64), age.reshape(1)
    fresh = parts._replace(cells=torch.zeros_like(parts.cells), points=parts.points[:0], driven=no_way())
    full = len(parts.done) >= p.count
    if len(parts.done) and (len(middles) < p.least or share > p.known or full):
        came = one_way(parts.came, parts.driven)
        fresh = left_out(fresh, int(overlap.argmax()))
        began = torch.cat((parts.begun[:-1], now))
        return fresh._replace(poses=torch.cat((parts.poses[:-1], here)), begun=began, came=came)
    number = len(parts.done)
    order = np.argsort(-overlap, kind="stable")[: p.most]
    found = [n for n in order.tolist() if overlap[n] >= p.least]
    pairs = torch.tensor([(n, number) for n in found], dtype=torch.float64).reshape(-1, 2)
    return fresh._replace(
        done=(*parts.done, Part(packed, middles, thinned(parts.points, p.points), parts.came)),
        poses=torch.cat((parts.poses, here)),
        begun=torch.cat((parts.begun, now)),
        came=parts.driven,
        pairs=torch.cat((parts.pairs, pairs)),
    )


def thinned(points: Tensor, most: int) -> Tensor:
    """At most so many of the points, evenly out of all."""
    return points[torch.linspace(0, len(points) - 1, min(most, len(points))).round().long()]


def overlaps(
    parts: Parts, middles: Tensor, early: npt.NDArray[np.bool_], p: PartParams
) -> tuple[npt.NDArray[np.int64], float]:
    """How many middles of a new part lie where each finished one has some, `[K]`, and the share known to several."""
    poses, count = parts.poses.numpy(), len(parts.done)
    if not count or not len(middles):
        return np.zeros(count, np.int64), 0.0
    mine = keys(placed(poses[-1], middles.numpy()), p.coarse)
    owner = np.repeat(np.arange(count), [len(part.middles) for part in parts.done])
    theirs = keys(placed(poses[owner], torch.cat([part.middles for part in parts.done]).numpy()), p.coarse)
    places, at = np.unique(mine, return_inverse=True)
    where = np.searchsorted(places, theirs)
    where[where == len(places)] = 0
    hit = places[where] == theirs
    seen = np.zeros((count, len(places)), bool)
    seen[owner[hit], where[hit]] = True
    weight = np.bincount(at, minlength=len(places))
    known = seen[~early].sum(0) >= p.seen
    return seen @ weight, float(weight[known].sum() / len(mine))


def placed(pose: Floats, points: Floats) -> Floats:
    """Points `[n, 2]` of frames, in the world."""
    return carried(pose, np.concatenate((points, np.zeros((len(points), 1))), -1))[:, :2]


def keys(points: Floats, side: float) -> npt.NDArray[np.int64]:
    """A number for the square that each point lies in."""
    at = np.floor(points / side).astype(np.int64)
    return at[:, 0] * (1 << 32) + at[:, 1]


def fit_pair(parts: Parts, dt: float, params: LocaliserParams) -> Parts:
    """Fit the next pair of parts that is left."""
    p = params.parts
    (first, second), pairs = map(int, parts.pairs[0].tolist()), parts.pairs[1:]
    poses = parts.poses.numpy()
    start = seen_from(poses[first], poses[second])
    # Points, not the middles of cells: these are a cell apart along any wall, and would lock into each other.
    scan = Scan(*np.ascontiguousarray(parts.done[second].points.numpy().T))
    known = unpack(parts.done[first].packed, params, p.size)
    x, y, heading = start.tolist()
    beside = [(x + i * p.aside, y + j * p.aside, heading) for i in (0, -1, 1) for j in (0, -1, 1)]
    fits = [fit_scan(known, scan, at, (p.loose, p.turned), params, p.steps) for at in beside]
    fit = max(fits, key=lambda one: one.score)
    parts = parts._replace(pairs=pairs)
    elsewhere = [one.score for one in fits if math.hypot(one.x - fit.x, one.y - fit.y) > p.apart]
    if fit.score < p.good or fit.score - max(elsewhere, default=0.0) < p.better:
        return parts
    trust = p.trust * (p.early if float(parts.begun[first]) * dt < float(parts.learning) else 1.0)
    edge = np.concatenate(((first, second, fit.x, fit.y, fit.heading), fit.information * trust))
    return parts._replace(edges=torch.cat((parts.edges, torch.from_numpy(edge)[None])))


def relaxed(parts: Parts, odometer: Floats, doubt: Floats, params: LocaliserParams) -> Parts:
    """Move the parts to where they fit each other and the way between them.

    Args:
        odometer, doubt: what is known of scale, bend and drift, and standard deviations, `[3]` each.
    """
    p = params.parts
    ways = way_edges([*(part.came for part in parts.done[1:]), parts.came], p)
    edges = np.concatenate((parts.edges.numpy(), ways.edges))
    change = np.concatenate((np.zeros((len(parts.edges), 3, 3)), ways.change))
    edges[:, 2:5] += change @ odometer
    links, poses, more = links_of(edges, change), parts.poses.numpy(), np.zeros(3)
    for _ in range(p.rounds):
        poses, more = relax(poses, links, p.gate, more, doubt)
    return parts._replace(poses=torch.from_numpy(poses))


class Ways(NamedTuple):
    """Edges `[K, 11]` to each part from the one before, by dead reckoning without what is known of its errors, and
    how their measures change with scale, bend and drift, `[K, 3, 3]`."""

    edges: Floats
    change: Floats


def way_edges(ways: list[Way], p: PartParams) -> Ways:
    """What was driven, as if scale, bend and drift were zero, and how it changes with them."""
    length, turned = (np.array([float(part) for part in parts]) for parts in zip(*(w[3:5] for w in ways), strict=True))
    unsure = torch.stack([way.unsure for way in ways]).numpy()
    change = torch.stack([way.change for way in ways])
    plain = torch.stack([way.pose for way in ways]) - (change @ torch.stack([w.known for w in ways])[..., None])[..., 0]
    edges = np.zeros((len(ways), FULL))
    edges[:, 0] = np.arange(len(ways))
    edges[:, 1] = edges[:, 0] + 1
    edges[:, 2:5] = plain.numpy()
    place = 1 / ((p.still + p.slip * length) ** 2 + unsure[:, 0])
    edges[:, 5], edges[:, 7] = place, place
    edges[:, 10] = 1 / ((p.turn_still + p.turn_way * length + p.turn_slip * turned) ** 2 + unsure[:, 1])
    return Ways(edges, change.numpy())


def redrawn(parts: Parts, dt: float, params: LocaliserParams) -> Tensor:
    """The walls of all parts where they are now, `[size, size, 6]`; of early ones where no other has seen any."""
    walls, old = empty_walls(params), empty_walls(params)
    cells = [*(part.packed.numpy() for part in parts.done), pack(parts.cells).double().numpy()]
    early = (parts.begun * dt < parts.learning).tolist()
    for (x, y, heading), packed, first in zip(parts.poses.tolist(), cells, early, strict=True):
        sums = (old if first else walls).numpy()
        kernel("add_cells").run(sums, packed, math.cos(heading), math.sin(heading), x, y, params.cell)
    if any(early):
        walls = torch.where(walls[..., :1] < params.least, walls + old, walls)
    return walls
