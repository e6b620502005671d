"""Objects over time: detections that follow one another become one track, with its features, times and places."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding.readout.owners import features_by_group
from ndtorch.binding.tracking.detections import SHADED, Detection, Floats, cosine, likeness, shaded
from ndtorch.binding.tracking.params import TrackParams
from ndtorch.vision.alpha_beta import corrected, predicted
from ndtorch.vision.camera.colors import SHADES
from ndtorch.vision.features import FEATURES, GROUPS

WIDTH = len(FEATURES) + len(SHADES) + 1
"""Signals that a track keeps: the ten features, the shades, and how much has a hue."""


class TrackTable(NamedTuple):
    """N tracks as tensors, as they are in a state. N and P, and the order, depend on the run.

    Attributes:
        number: of every track, in the order in which they began, `[N]` int64.
        heading, outputs, inputs, winners, velocity: as in `Track`, `[N, 2]`, `[N, 14]` and so on.
        fields: the fields of its latest detection, `[N, F]` bool.
        length: detections of every track, `[N]` int64.
        path: all their detections, track after track, `[P, 4]`.
    """

    number: Tensor
    heading: Tensor
    outputs: Tensor
    inputs: Tensor
    winners: Tensor
    velocity: Tensor
    fields: Tensor
    length: Tensor
    path: Tensor


@dataclass
class Track:
    """One thing and what was seen of it.

    Attributes:
        number: in the order in which tracks began.
        heading: sum of the unit vectors of its motion (right, down).
        outputs, inputs: sums over its detections, `[14]`.
        winners: how often each neuron had the largest output in it, `[10]`.
        velocity: row and column, shares of the picture a second.
        fields: the fields of its latest detection.
        before: time in seconds, row and column (shares of the picture) and strength of detections, `[n, 4]`,
        late: and of the latest ones.
    """

    number: int
    heading: Floats
    outputs: Floats
    inputs: Floats
    winners: Floats
    velocity: Floats
    fields: list[int]
    before: Floats
    late: list[tuple[float, float, float, float]] = field(default_factory=list)

    @property
    def path(self) -> Floats:
        """Time, row, column and strength of every detection, `[n, 4]`."""
        return np.concatenate([self.before, np.array(self.late).reshape(-1, 4)]) if self.late else self.before

    @property
    def last(self) -> tuple[float, float, float, float]:
        """The latest detection."""
        if self.late:
            return self.late[-1]
        time, row, column, strength = self.before[-1].tolist()
        return time, row, column, strength

    @property
    def first_seen(self) -> float:
        """Seconds since the first frame."""
        return float(self.before[0, 0]) if len(self.before) else self.late[0][0]

    @property
    def last_seen(self) -> float:
        """Time of the latest detection."""
        return self.last[0]

    @property
    def index(self) -> int:
        """Number of the neuron that stood for it most of the time."""
        return int(self.winners.argmax())

    def features(self, smallest: float) -> dict[str, float]:
        """Features over the largest of their group, those under `smallest` left out, and hues where it has a shade."""
        row = features_by_group(torch.from_numpy(self.inputs[: len(FEATURES)]), smallest)
        if self.shade is not None:
            row[GROUPS["color"]] = 0.0
        return {name: value for name, value in zip(FEATURES, row.tolist(), strict=True) if value > 0}

    @property
    def shade(self) -> str | None:
        """White, grey or black, the strongest, where it has more of them than of any hue."""
        return SHADES[int(self.inputs[SHADED].argmax())] if shaded(self.inputs) else None

    def add(self, time: float, seen: Detection, tau_velocity: float) -> None:
        """Take another detection: the place as it is seen, the velocity by the alpha-beta filter."""
        if self.late or len(self.before):
            gap = time - self.last_seen
            there = self.expected(time)
            residual = np.array(seen.place) - there
            _, self.velocity = corrected(there, self.velocity, residual, 1.0, gap / (tau_velocity + gap), gap)
        self.late.append((time, *seen.place, seen.strength))
        self.heading = self.heading + seen.motion / max(float(np.hypot(*seen.motion)), 1e-12)
        self.outputs, self.inputs = self.outputs + seen.outputs, self.inputs + seen.inputs
        self.winners = self.winners.copy()
        self.winners[int(seen.outputs[: len(FEATURES)].argmax())] += 1
        self.fields = seen.fields

    def expected(self, time: float) -> Floats:
        """Row and column it should have reached."""
        last, row, column, _ = self.last
        return predicted(np.array([row, column]), self.velocity, time - last)


def begun(number: int) -> Track:
    """A track without detections."""
    return Track(number, np.zeros(2), np.zeros(WIDTH), np.zeros(WIDTH), np.zeros(10), np.zeros(2), [], np.zeros((0, 4)))


def tracks_of(table: TrackTable) -> list[Track]:
    """The tracks of a table. They share its memory and never write to it."""
    paths = np.split(table.path.numpy(), np.cumsum(table.length.numpy())[:-1]) if len(table.number) else []
    shown = [row.nonzero().flatten().tolist() for row in table.fields]
    parts = (part.numpy() for part in (table.heading, table.outputs, table.inputs, table.winners, table.velocity))
    rows = zip(table.number.tolist(), *parts, shown, paths, strict=True)
    return [Track(*row) for row in rows]


def table_of(tracks: Sequence[Track], fields: int) -> TrackTable:
    """Tracks as tensors."""
    count = len(tracks)

    def stacked(parts: list[Floats], width: int) -> Tensor:
        return torch.from_numpy(np.stack(parts)) if parts else torch.zeros(0, width, dtype=torch.float64)

    shown = torch.zeros(count, fields, dtype=torch.bool)
    for n, track in enumerate(tracks):
        shown[n, track.fields] = True
    paths = [track.path for track in tracks]
    return TrackTable(
        torch.tensor([track.number for track in tracks], dtype=torch.int64),
        stacked([track.heading for track in tracks], 2),
        stacked([track.outputs for track in tracks], WIDTH),
        stacked([track.inputs for track in tracks], WIDTH),
        stacked([track.winners for track in tracks], 10),
        stacked([track.velocity for track in tracks], 2),
        shown,
        torch.tensor([len(path) for path in paths], dtype=torch.int64),
        torch.from_numpy(np.concatenate(paths)) if paths else torch.zeros(0, 4, dtype=torch.float64),
    )


def follow(
    open_: list[Track], time: float, seen: list[Detection], began: int, aspect: float, criteria: TrackParams
) -> tuple[list[Track], list[Track]]:
    """Give every detection to the track it fits best, nearest first; new tracks for the rest.

    Args:
        open_: tracks that may be in sight; those that get a detection are changed.
        began: tracks begun so far.
        aspect: width of the picture over its height.

    Returns:
        the tracks that are open now, and those that were out of sight for too long.
    """
    c = criteria
    late = [track for track in open_ if time - track.last_seen > c.coast]
    kept = [track for track in open_ if time - track.last_seen <= c.coast]
    pairs = []
    for i, track in enumerate(kept):
        gate = c.gate + c.reach * min(time - track.last_seen, c.widest)
        there = track.expected(time)
        for j, sight in enumerate(seen):
            away = distance(there, sight.place, aspect)
            # What else counts can only add to that.
            if away >= gate:
                continue
            unlike = 1 - likeness(track.outputs, sight.outputs)
            turned = (1 - cosine(track.heading, sight.motion)) / 2
            cost = away / gate + c.unlike * unlike + c.turn * turned
            if cost < 1:
                pairs.append((cost, i, j))
    given: set[int] = set()
    taken: set[int] = set()
    for _, i, j in sorted(pairs):
        if i not in given and j not in taken:
            given.add(i)
            taken.add(j)
            kept[i].add(time, seen[j], c.tau_velocity)
    for j, sight in enumerate(seen):
        if j not in taken:
            track = begun(began)
            began += 1
            track.add(time, sight, c.tau_velocity)
            kept.append(track)
    return kept, late


def distance(a: Sequence[float] | Floats, b: Sequence[float] | Floats, aspect: float) -> float:
    """Between two places (row, column), heights of the picture."""
    return math.hypot(a[0] - b[0], (a[1] - b[1]) * aspect)


def standing(tracks: Sequence[Track], dt: float, aspect: float, criteria: TrackParams) -> list[Track]:
    """The objects among tracks, in the order in which they appeared: what was in sight long enough, moved along and
    kept its direction; parts of one thing, and what came out again from behind something, joined."""
    good = [track for track in tracks if stands(track, dt, aspect, criteria)]
    good.sort(key=lambda track: -sum(track.path[:, 3].tolist()))
    kept: list[Track] = []
    for track in good:
        same = next((k for k, other in enumerate(kept) if is_same(other, track, aspect, criteria)), None)
        if same is None:
            kept.append(track)
        else:
            kept[same] = joined(kept[same], track)
    return sorted(kept, key=lambda track: track.first_seen)


def way(track: Track, aspect: float, ends: float) -> Floats:
    """From the first end of its path to the last, each a share `ends` of it, down and right, heights."""
    places = track.path[:, 1:3] * np.array([1.0, aspect])
    k = max(1, int(ends * len(places)))
    return np.asarray(places[-k:].mean(0) - places[:k].mean(0))


def stands(track: Track, dt: float, aspect: float, criteria: TrackParams) -> bool:
    """Whether a track is one of an object."""
    c, n = criteria, len(track.path)
    straight = float(np.hypot(*track.heading)) / n
    far = float(np.hypot(*way(track, aspect, c.ends))) >= c.travel
    return n * dt >= c.shortest and far and straight >= c.straight


def is_same(one: Track, other: Track, aspect: float, criteria: TrackParams) -> bool:
    """Whether two tracks are of parts of one object, or of one before and after it was hidden."""
    c = criteria
    ways = way(one, aspect, c.ends), way(other, aspect, c.ends)
    if likeness(one.outputs, other.outputs) < c.alike or cosine(*ways) < c.along:
        return False
    places = {time: (row, column) for time, row, column, _ in one.path.tolist()}
    there = other.path.tolist()
    apart = [distance(places[t], (row, column), aspect) for t, row, column, _ in there if t in places]
    if len(apart) > c.together * len(there):
        return float(np.median(apart)) < c.beside
    earlier = one.first_seen < other.first_seen
    first, second = (one, other) if earlier else (other, one)
    gap = second.first_seen - first.last_seen
    seconds = max(first.last_seen - first.first_seen, c.steady)
    down, right = ways[0 if earlier else 1] / seconds * max(gap, 0.0)
    _, row, column, _ = first.last
    heading_for = (row + down, column + right / aspect)
    return gap < c.behind and distance(heading_for, second.path[0, 1:3], aspect) < c.comes_back


def joined(one: Track, other: Track) -> Track:
    """Both as one."""
    path = {point[0]: point for point in other.path.tolist()}
    path.update({point[0]: point for point in one.path.tolist()})
    return Track(
        one.number,
        one.heading + other.heading,
        one.outputs + other.outputs,
        one.inputs + other.inputs,
        one.winners + other.winners,
        one.velocity,
        one.fields,
        np.array([path[time] for time in sorted(path)]),
    )
