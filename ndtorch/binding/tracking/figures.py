"""Figures over time: regions that stand out are given to the tracks that expected them; groups merge and split."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from pydantic import Field
from torch import Tensor

from ndtorch.binding.tracking.regions import Floats, Labels, Regions
from ndtorch.config import Constants

Numbers = npt.NDArray[np.float64]
SIGHTING = 10
"""Numbers kept of every sighting: time, row and column of its middle, top, left, bottom and right, pixels, and row and
column by which it is followed."""
PIXELS, FOLLOWED = 7, slice(8, 10)


class FigureParams(Constants):
    """How regions become tracks. Lengths as shares of the object's own size unless they say otherwise, times in
    seconds."""

    smallest: float = Field(0.0005, gt=0, description="smallest region, as a share of the picture")
    gap: float = Field(0.02, ge=0, description="gaps that are closed, as a share of the picture's height")
    still: float = Field(0.5, ge=0, description="what has not moved for this long may be a hole in memory")
    shared: float = Field(0.3, gt=0, description="share of a region or of a track's box that makes them meet")
    piece: float = Field(0.6, gt=0, description="share of a region inside a track's box that makes it a piece of it")
    gate: float = Field(1.0, gt=0, description="how far from where a track is expected a region may be,")
    reach: float = Field(1.0, ge=0, description="and how much further a second later")
    unlike: float = Field(2.0, ge=0, description="cost of another color (full scale), where a gate's distance costs 1")
    alike_size: float = Field(3.0, gt=1, description="largest ratio of the areas of two sightings apart")
    follow: float = Field(0.6, gt=0, le=1, description="share of the difference taken into the place")
    tau_velocity: float = Field(0.4, ge=0, description="a sighting after t changes the velocity by t / (this + t)")
    tau_size: float = Field(0.4, ge=0, description="memory of the size and of the color")
    coast: float = Field(1.0, ge=0, description="how long a track out of sight is waited for")
    warm_up: float = Field(1.0, ge=0, description="nothing is called an object before; the ground is not known yet")
    shortest: float = Field(0.3, ge=0, description="smallest time in sight of an object")
    travel: float = Field(0.7, ge=0, description="smallest way gone; 0 reports what does not travel too")
    larger: float = Field(2.0, ge=1, description="a track of this many times its pixels,")
    beside: float = Field(1.0, ge=0, description="nearer than this share of the other's size,")
    fate: float = Field(0.5, ge=0, description="whose velocity differs by less than this share, is what it is part of")
    rests: float = Field(1.5, ge=0, description="an object that did not go half its size for this long rests")
    stays: float = Field(60.0, ge=0, description="what stops stays an object for this long")
    doubtful: float = Field(1.0, ge=0, description="what never travelled is learned as ground after this long")


class FigureTable(NamedTuple):
    """N tracks as tensors, as they are in a state. N and P depend on the run.

    Attributes:
        number: of every track, in the order in which they began, `[N]` int64.
        known: whether it is an object, `[N]` bool.
        velocity: rows and columns (shares of the height) a second, `[N, 2]` float64.
        extent: remembered height and width, shares of the height, `[N, 2]`.
        color: remembered color, `[N, 3]`.
        start: place at which it began, `[N, 2]`; moved: time at which it last moved on, `[N]`.
        rest: place at that time, `[N, 2]`.
        inputs, outputs: of the network, sums over its sightings, `[N, 10]`.
        length: sightings of every track, `[N]` int64.
        path: all their sightings, track after track, `[P, 10]`: time, and in shares of the height row and column of its
            middle, top, left, bottom and right, pixels, and row and column by which it is followed.
    """

    number: Tensor
    known: Tensor
    velocity: Tensor
    extent: Tensor
    color: Tensor
    start: Tensor
    moved: Tensor
    rest: Tensor
    inputs: Tensor
    outputs: Tensor
    length: Tensor
    path: Tensor


@dataclass
class Figure:
    """One track: the attributes are those of `FigureTable`."""

    number: int
    known: bool
    velocity: Numbers
    extent: Numbers
    color: Numbers
    start: Numbers
    moved: float
    rest: Numbers
    inputs: Numbers
    outputs: Numbers
    before: Numbers
    late: list[tuple[float, ...]] = field(default_factory=list)

    @property
    def path(self) -> Numbers:
        """All sightings, `[n, 10]`."""
        return np.concatenate([self.before, np.array(self.late).reshape(-1, SIGHTING)]) if self.late else self.before

    @property
    def last(self) -> tuple[float, ...]:
        """The latest sighting."""
        return self.late[-1] if self.late else tuple(self.before[-1].tolist())

    @property
    def first_seen(self) -> float:
        """Seconds since the first frame."""
        return float(self.before[0, 0]) if len(self.before) else self.late[0][0]

    @property
    def last_seen(self) -> float:
        """Time of the latest sighting."""
        return self.last[0]

    @property
    def size(self) -> float:
        """Mean of height and width."""
        return float(self.extent.mean())

    def expected(self, time: float) -> Numbers:
        """Row and column it should have reached."""
        last = self.last
        # What is lost is not followed out of the picture for ever.
        ahead = min(time - last[0], 0.5)
        return np.array(last[FOLLOWED]) + self.velocity * ahead

    def box(self, time: float) -> Numbers:
        """Top, left, bottom and right of where it should be."""
        place = self.expected(time)
        return np.concatenate([place - self.extent / 2, place + self.extent / 2])


class Sighting(NamedTuple):
    """What a track gets at one step: row and column of its pixel nearest to their mean, middle of its box, height and
    width, pixels, color, and whether it shares its region."""

    inner: Numbers
    place: Numbers
    extent: Numbers
    pixels: float
    color: Numbers
    shared: bool


def figures_of(table: FigureTable) -> list[Figure]:
    """The tracks of a table. They share its memory and never write to it."""
    paths = np.split(table.path.numpy(), np.cumsum(table.length.numpy())[:-1]) if len(table.number) else []
    rows = zip(
        table.number.tolist(),
        table.known.tolist(),
        table.velocity.numpy(),
        table.extent.numpy(),
        table.color.numpy(),
        table.start.numpy(),
        table.moved.tolist(),
        table.rest.numpy(),
        table.inputs.numpy(),
        table.outputs.numpy(),
        paths,
        strict=True,
    )
    return [Figure(*row) for row in rows]


def table_of(figures: Sequence[Figure]) -> FigureTable:
    """Tracks as tensors."""

    def stacked(parts: list[Numbers], width: int) -> Tensor:
        return torch.from_numpy(np.stack(parts)) if parts else torch.zeros(0, width, dtype=torch.float64)

    paths = [one.path for one in figures]
    return FigureTable(
        torch.tensor([one.number for one in figures], dtype=torch.int64),
        torch.tensor([one.known for one in figures], dtype=torch.bool),
        stacked([one.velocity for one in figures], 2),
        stacked([one.extent for one in figures], 2),
        stacked([one.color for one in figures], 3),
        stacked([one.start for one in figures], 2),
        torch.tensor([one.moved for one in figures], dtype=torch.float64),
        stacked([one.rest for one in figures], 2),
        stacked([one.inputs for one in figures], 10),
        stacked([one.outputs for one in figures], 10),
        torch.tensor([len(path) for path in paths], dtype=torch.int64),
        torch.from_numpy(np.concatenate(paths)) if paths else torch.zeros(0, SIGHTING, dtype=torch.float64),
    )


def follow(
    figures: list[Figure], time: float, regions: Regions, picture: Floats, began: int, p: FigureParams
) -> tuple[list[Figure], list[Figure], Labels]:
    """One step: every track to the region that fills most of its expected box, those left over by distance and color.

    A region that is that of several known tracks is shared: each of its pixels goes to the track whose box is nearest,
    in sizes of that box. Other regions inside a track's expected box are pieces of it. What is left begins a track.

    Args:
        figures: open tracks; those that are seen are changed.
        time: seconds.
        regions: of this step.
        picture: `[3, h, w]`.
        began: tracks begun so far.
        p: constants.

    Returns:
        the open tracks, those that were out of sight for too long, and the silhouettes: the number of the track of
        every pixel plus one, 0 where none is, `[h, w]`.
    """
    labels, height = regions.labels, regions.labels.shape[0]
    late = [one for one in figures if time - one.last_seen > p.coast]
    kept = [one for one in figures if time - one.last_seen <= p.coast]
    count = len(regions.areas)
    given, pieces = meeting(kept, time, regions, p)
    taken = {k for ks in given.values() for k in ks}
    for k, r in apart(kept, taken, {r: given[r] for r in given if r not in pieces}, regions, picture, time, p):
        given[r].append(k)
    owners = np.zeros(count + 1, np.int32)
    groups: list[tuple[int, list[Figure]]] = []
    absorbed: set[int] = set()
    for r in range(count):
        ones, parts = visible([kept[k] for k in given[r]], regions.areas[r] / height**2, p)
        absorbed |= {one.number for one in parts}
        if len(ones) > 1:
            groups.append((r, ones))
        elif ones:
            owners[r + 1] = ones[0].number + 1
        elif r in pieces:
            owners[r + 1] = kept[pieces[r]].number + 1
        else:
            began += 1
            owners[r + 1] = began
            box = regions.boxes[r]
            kept.append(start(began - 1, time, np.array([box[0] + box[2], box[1] + box[3]]) / 2 / height))
    silhouettes: Labels = owners[labels]
    for r, ones in groups:
        share(silhouettes, labels, r, regions.boxes[r], ones, time)
    shared = {one.number for _, ones in groups for one in ones}
    boxes = bounds(silhouettes, began)
    for one in kept:
        seen = sighting(one, silhouettes, boxes, picture, one.number in shared)
        if seen is not None:
            add(one, time, seen, p)
    for one in kept:
        if (
            time >= p.warm_up
            and not one.known
            and one.last_seen == time
            and travels(one, p)
            and not part_of_another(one, kept, p)
        ):
            one.known = True
    return [one for one in kept if one.number not in absorbed], late, silhouettes


def travels(one: Figure, p: FigureParams) -> bool:
    """Whether a track has been in sight for long enough and has gone far enough."""
    far = float(np.hypot(*(np.array(one.last[FOLLOWED]) - one.start)))
    return far >= p.travel * one.size and one.last_seen - one.first_seen >= p.shortest


def part_of_another(one: Figure, others: Sequence[Figure], p: FigureParams) -> bool:
    """Whether a much larger track beside it moves as it does: common fate. So do shadows, and pieces of a thing."""
    time, top, left, bottom, right = one.last[0], *one.last[3:7]
    speed = float(np.hypot(*one.velocity))
    for other in others:
        if other is one or other.last_seen != time or other.last[PIXELS] < p.larger * one.last[PIXELS]:
            continue
        box = other.last[3:7]
        gap = max(top - box[2], box[0] - bottom, left - box[3], box[1] - right)
        apart = float(np.hypot(*(one.velocity - other.velocity)))
        if gap < p.beside * other.size and apart < p.fate * max(speed, float(np.hypot(*other.velocity))):
            return True
    return False


def visible(ones: list[Figure], area: float, p: FigureParams) -> tuple[list[Figure], list[Figure]]:
    """Of the tracks whose region is one: those that are seen in it, and those that were pieces of another one.

    A young track that runs into a known one was a piece of it, and of young ones only the oldest stays. Known tracks
    that are together much smaller than their region were pieces of one thing, and so was a small one that moves as the
    largest does. Of the others, the oldest are seen for as many as there is room for; the rest is hidden.
    """
    known = [one for one in ones if one.known]
    if not known:
        first = sorted(ones, key=lambda one: one.number)
        return first[:1], first[1:]
    parts = [one for one in ones if not one.known]
    known.sort(key=lambda one: one.number)
    if len(known) > 1 and sum(one.last[PIXELS] for one in known) < area / p.larger:
        return known[:1], parts + known[1:]
    largest = max(known, key=lambda one: one.last[PIXELS])
    shown: list[Figure] = []
    for one in known:
        small = one.last[PIXELS] * p.larger < largest.last[PIXELS]
        if small and float(np.hypot(*(one.velocity - largest.velocity))) < p.fate * float(np.hypot(*largest.velocity)):
            parts.append(one)
        elif not shown or sum(other.last[PIXELS] for other in shown) + 0.5 * one.last[PIXELS] < area:
            shown.append(one)
    return shown or [largest], parts


def meeting(
    figures: list[Figure], time: float, regions: Regions, p: FigureParams
) -> tuple[dict[int, list[int]], dict[int, int]]:
    """The tracks of each region, and the track of every region that is a piece of one."""
    height, width = regions.labels.shape
    count = len(regions.areas)
    inside = np.zeros((len(figures), count))
    for k, one in enumerate(figures):
        box = one.box(time) * height
        top, left = max(0, math.floor(box[0])), max(0, math.floor(box[1]))
        bottom, right = min(height, math.ceil(box[2])), min(width, math.ceil(box[3]))
        if bottom > top and right > left and count:
            window = regions.labels[top:bottom, left:right]
            inside[k] = np.bincount(window.ravel(), minlength=count + 1)[1:]
    given: dict[int, list[int]] = {r: [] for r in range(count)}
    pieces: dict[int, int] = {}
    for k, one in enumerate(figures):
        if count:
            r = int(inside[k].argmax())
            if inside[k, r] > p.shared * min(regions.areas[r], one.last[PIXELS] * height * height):
                given[r].append(k)
    for r in range(count):
        if not given[r] and len(figures):
            k = int(inside[:, r].argmax())
            if inside[k, r] > p.piece * regions.areas[r]:
                pieces[r] = k
    return given, pieces


def bounds(silhouettes: Labels, count: int) -> dict[int, tuple[int, int, int, int, int]]:
    """Top, left, bottom, right and pixels of every silhouette, by its number plus one."""
    rows, columns = np.nonzero(silhouettes)
    if not len(rows):
        return {}
    names = silhouettes[rows, columns]
    found, where, number = np.unique(names, return_inverse=True, return_counts=True)
    n = len(found)
    top, left = np.full(n, 1 << 30), np.full(n, 1 << 30)
    bottom, right = np.zeros(n, np.int64), np.zeros(n, np.int64)
    np.minimum.at(top, where, rows)
    np.minimum.at(left, where, columns)
    np.maximum.at(bottom, where, rows + 1)
    np.maximum.at(right, where, columns + 1)
    parts = zip(found, top, left, bottom, right, number, strict=True)
    return {int(name): (int(t), int(u), int(b), int(v), int(m)) for name, t, u, b, v, m in parts}


def apart(
    figures: list[Figure],
    taken: set[int],
    given: dict[int, list[int]],
    regions: Regions,
    picture: Floats,
    time: float,
    p: FigureParams,
) -> list[tuple[int, int]]:
    """Pairs of tracks and regions that met nothing, by distance, color and size, the cheapest assignment."""
    from scipy.optimize import linear_sum_assignment

    lost, free = [k for k in range(len(figures)) if k not in taken], [r for r, ks in given.items() if not ks]
    if not lost or not free:
        return []
    height = regions.labels.shape[0]
    cost = np.full((len(lost), len(free)), 1e3)
    for j, r in enumerate(free):
        top, left, bottom, right = regions.boxes[r]
        window = regions.labels[top:bottom, left:right] == r + 1
        color = picture[:, top:bottom, left:right][:, window].mean(1)
        place = np.array([(top + bottom) / 2, (left + right) / 2]) / height
        for i, k in enumerate(lost):
            one = figures[k]
            ratio = regions.areas[r] / height**2 / max(one.last[PIXELS], 1e-9)
            if not 1 / p.alike_size < ratio < p.alike_size:
                continue
            reach = p.gate * one.size * (1 + p.reach * (time - one.last_seen))
            away = float(np.hypot(*(place - one.expected(time)))) / reach
            value = away + p.unlike * float(np.abs(color - one.color).max())
            if value < 1:
                cost[i, j] = value
    rows, columns = linear_sum_assignment(cost)
    return [(lost[i], free[j]) for i, j in zip(rows, columns, strict=True) if cost[i, j] < 1]


def share(
    silhouettes: Labels, labels: Labels, r: int, box: npt.NDArray[np.int64], ones: list[Figure], time: float
) -> None:
    """Give each pixel of a region to the nearest of several tracks."""
    height = labels.shape[0]
    top, left, bottom, right = box
    rows = (np.arange(top, bottom) + 0.5)[:, None] / height
    columns = (np.arange(left, right) + 0.5)[None] / height
    away = []
    for one in ones:
        place = one.expected(time)
        away.append(((rows - place[0]) / one.extent[0]) ** 2 + ((columns - place[1]) / one.extent[1]) ** 2)
    nearest = np.array([one.number + 1 for one in ones], np.int32)[np.argmin(np.stack(away), 0)]
    window = labels[top:bottom, left:right] == r + 1
    silhouettes[top:bottom, left:right][window] = nearest[window]


def start(number: int, time: float, place: Numbers) -> Figure:
    """A track without sightings."""
    two, ten = np.zeros(2), np.zeros(10)
    return Figure(number, False, two, two, np.zeros(3), place, time, place, ten, ten, np.zeros((0, SIGHTING)))


def sighting(
    one: Figure,
    silhouettes: Labels,
    boxes: dict[int, tuple[int, int, int, int, int]],
    picture: Floats,
    shared: bool,
) -> Sighting | None:
    """What the silhouettes show of a track; None if nothing."""
    if one.number + 1 not in boxes:
        return None
    height = silhouettes.shape[0]
    top, left, bottom, right, pixels = boxes[one.number + 1]
    window = silhouettes[top:bottom, left:right] == one.number + 1
    color = picture[:, top:bottom, left:right][:, window].mean(1).astype(np.float64)
    place = np.array([(top + bottom) / 2, (left + right) / 2]) / height
    extent = np.array([bottom - top, right - left]) / height
    rows, columns = np.nonzero(window)
    k = int(((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2).argmin())
    inner = np.array([rows[k] + top + 0.5, columns[k] + left + 0.5]) / height
    return Sighting(inner, place, extent, pixels / height**2, color, shared)


def add(one: Figure, time: float, seen: Sighting, p: FigureParams) -> None:
    """Take a sighting. In a shared region the size is remembered, not seen."""
    place, pixels = seen.place, seen.pixels
    if one.late or len(one.before):
        gap = time - one.last_seen
        there = one.expected(time)
        share_of = p.follow * (0.5 if seen.shared else 1.0)
        place = there + share_of * (seen.place - there) if seen.shared else seen.place
        residual = place - there
        # Of a young track the mean of all steps so far.
        pace = max(gap / (p.tau_velocity + gap), 1 / (len(one.before) + len(one.late)))
        one.velocity = one.velocity + pace * residual / max(gap, 1e-9)
        if seen.shared:
            pixels = one.last[PIXELS]
        else:
            keep = gap / (p.tau_size + gap)
            one.extent = one.extent + keep * (seen.extent - one.extent)
            one.color = one.color + keep * (seen.color - one.color)
    else:
        one.extent, one.color = seen.extent, seen.color
    if float(np.hypot(*(place - one.rest))) > 0.5 * one.size:
        one.moved, one.rest = time, place
    extent = one.extent if seen.shared else seen.extent
    box = (*(place - extent / 2).tolist(), *(place + extent / 2).tolist())
    one.late.append((time, *seen.inner.tolist(), *box, pixels, *place.tolist()))
