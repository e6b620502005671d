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

from ndtorch.kernels.add_cells import add_cells
from ndtorch.kernels.add_points import add_points
from ndtorch.navigation.localisation.graph import FULL, Links, carried, doubts, links_of, relax, seen_from
from ndtorch.navigation.localisation.params import LocaliserParams, PartParams
from ndtorch.navigation.localisation.walls import Scan, empty_walls, pack
from ndtorch.navigation.localisation.way import Way, no_way, one_way, way_edges
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
        pairs: that are still to be fitted, and covariances of the second as seen from the first, `[n, 11]`.
        aside: frames of parts that were left out, which move with the finished part that shows most of the same,
            `[n, 5]`: steps after which it was begun, the number of that part, and the pose in its frame.
        scans: likewise, frames of single scans, half a step after each, which move by themselves as long as the way
            since the start will be gone through again.
        learning: parts begun in this time from the start, s, count only where nothing was seen later.
        waiting: fits that would move much and that no other has confirmed, like `edges`, see `agreeing`.
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
    waiting: Tensor


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
        zeros.new_zeros(0, 11),
        zeros[None, :5][:0],
        zeros[None, :5][:0],
        zeros.new_tensor(params.parts.learning),
        zeros[None][:0],
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
    add_points(cells.numpy(), *place, scan.weight, params.cell, params.most)
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


def is_ripe(parts: Parts, params: LocaliserParams) -> bool:
    """Whether the part that is being made is long enough and shows enough to be told by, or is as long as it may be."""
    p, length = params.parts, float(parts.driven.length)
    if length <= p.way:
        return False
    return length > p.longest or int((parts.cells[..., 0] >= params.least).sum()) >= p.ripe


def finish(
    parts: Parts,
    pose: tuple[float, float, float],
    age: Tensor,
    dt: float,
    odometer: Floats,
    doubt: Floats,
    params: LocaliserParams,
) -> Parts:
    """End a part at a pose, where the next one begins. One that shows nothing new is left out.

    Args:
        odometer, doubt: what is known of scale, bend and drift, and standard deviations, `[3]` each.
    """
    p = params.parts
    packed = pack(parts.cells)
    packed = packed[packed[:, 2] >= params.least].double()
    middles = (packed[:, :2] + 0.5) * params.cell + packed[:, 3:5] / packed[:, 2:3]
    overlap, share = overlaps(parts, middles, parts.begun[:-1].numpy() * dt < float(parts.learning), p)
    here, now = torch.tensor([pose], dtype=torch.float64), age.reshape(1)
    fresh = parts._replace(cells=torch.zeros_like(parts.cells), points=parts.points[:0], driven=no_way())
    full, since = len(parts.done) >= p.count, float(parts.came.length + parts.driven.length)
    # After a long way through what is known, the way alone ties the next part, and one wrong fit would turn it.
    if len(parts.done) and (len(middles) < p.least or (share > p.known and since < p.gap) or full):
        came = one_way(parts.came, parts.driven)
        fresh = left_out(fresh, int(overlap.argmax()))
        began = torch.cat((parts.begun[:-1], now))
        return fresh._replace(poses=torch.cat((parts.poses[:-1], here)), begun=began, came=came)
    number = len(parts.done)
    # Not by number: the few cells of an early part in a bare corridor would never be among the most.
    size = np.array([len(part.middles) for part in parts.done], float).clip(1, max(1, len(middles)))
    order = np.argsort(-overlap / size, kind="stable")
    found = [n for n in order.tolist() if overlap[n] >= p.least][: p.most]
    sure = np.zeros((0, 3, 3))
    if found:
        links = links_between(parts, odometer, params)
        sure = doubts(parts.poses.numpy(), links, p.gate, doubt, number, np.array(found, np.int64))
    pairs = torch.tensor([(n, number) for n in found], dtype=torch.float64).reshape(-1, 2)
    pairs = torch.cat((pairs, torch.from_numpy(sure.reshape(-1, 9))), 1)
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


def links_between(parts: Parts, odometer: Floats, params: LocaliserParams) -> Links:
    """All edges, with what was driven as it is with some scale, bend and drift, `[3]`."""
    ways = way_edges([*(part.came for part in parts.done[1:]), parts.came], params.parts)
    edges = np.concatenate((parts.edges.numpy(), ways.edges))
    change = np.concatenate((np.zeros((len(parts.edges), 3, 3)), ways.change))
    edges[:, 2:5] += change @ odometer
    return links_of(edges, change)


def relaxed(parts: Parts, odometer: Floats, doubt: Floats, params: LocaliserParams) -> Parts:
    """Move the parts to where they fit each other and the way between them.

    Args:
        odometer, doubt: what is known of scale, bend and drift, and standard deviations, `[3]` each.
    """
    p = params.parts
    links, poses, more = links_between(parts, odometer, params), parts.poses.numpy(), np.zeros(3)
    for _ in range(p.rounds):
        poses, more = relax(poses, links, p.gate, more, doubt)
    return parts._replace(poses=torch.from_numpy(poses))


def redrawn(parts: Parts, dt: float, params: LocaliserParams) -> Tensor:
    """The walls of all parts where they are now, `[size, size, 6]`; of early ones where no other has seen any."""
    walls, old = empty_walls(params), empty_walls(params)
    cells = [*(part.packed.numpy() for part in parts.done), pack(parts.cells).double().numpy()]
    early = (parts.begun * dt < parts.learning).tolist()
    for (x, y, heading), packed, first in zip(parts.poses.tolist(), cells, early, strict=True):
        sums = (old if first else walls).numpy()
        add_cells(sums, packed, math.cos(heading), math.sin(heading), x, y, params.cell)
    if any(early):
        walls = torch.where(walls[..., :1] < params.least, walls + old, walls)
    return walls
