"""Objects over time: sightings that follow one another become one object, with its features, times and places."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding.readout.owners import features_by_group
from ndtorch.binding.tracking.detections import (
    Floats,
    Sighting,
    SightingCriteria,
    cosine,
    likeness,
    sightings,
    strengths,
)
from ndtorch.vision.camera.front_end import FieldSignals
from ndtorch.vision.features import FEATURES

DIRECTIONS = FEATURES[:4]


@dataclass(frozen=True)
class FileCriteria:
    """How sightings become objects. Lengths in heights of the picture, times in seconds.

    Attributes:
        tau: motion is averaged over this long before sightings are made.
        settle: the first moments, when nothing is known of background and noise.
        gate: how far from where an object is expected a sighting may be; reach: how much further a second later.
        unlike: cost of features that have nothing in common, where a gate's distance costs 1.
        turn: cost of moving the other way.
        coast: how long an object that is out of sight is waited for.
        shortest: smallest time in sight; travel: smallest way gone; straight: smallest agreement of its directions.
        alike: likeness from which on two objects may be parts of one.
        beside: parts of one object stay this near to each other.
        behind: an object may be hidden this long,
        return_: and comes back this near to where it was heading.
    """

    tau: float = 0.1
    settle: float = 0.3
    gate: float = 0.25
    reach: float = 0.3
    unlike: float = 0.5
    turn: float = 0.8
    coast: float = 1.2
    shortest: float = 0.4
    travel: float = 0.15
    straight: float = 0.6
    alike: float = 0.8
    beside: float = 0.25
    behind: float = 2.0
    return_: float = 0.5


@dataclass
class ObjectFile:
    """One object and what was seen of it.

    Attributes:
        path: time in seconds, row and column (shares of the picture) and strength of every sighting.
        heading: sum of the unit vectors of its motion (right, down).
        outputs, inputs: sums over its sightings, `[10]`.
        winners: how often each neuron had the largest output in it, `[10]`.
        velocity: row and column, shares a second.
        fields: the fields of its latest sighting.
    """

    path: list[tuple[float, float, float, float]]
    heading: Floats
    outputs: Floats
    inputs: Floats
    winners: Floats
    velocity: tuple[float, float] = (0.0, 0.0)
    fields: list[int] = field(default_factory=list)

    @property
    def appeared(self) -> float:
        """Seconds since the first frame."""
        return self.path[0][0]

    @property
    def disappeared(self) -> float:
        """Time of the last sighting."""
        return self.path[-1][0]

    @property
    def direction(self) -> str:
        """The main one of left, right, down, up, by the motion signals."""
        right, down = self.heading
        if abs(right) > abs(down):
            return "right" if right > 0 else "left"
        return "down" if down > 0 else "up"

    @property
    def neuron(self) -> str:
        """The neuron that stood for it most of the time."""
        return FEATURES[int(self.winners.argmax())]

    @property
    def features(self) -> dict[str, float]:
        """Features over the largest of their group, small ones left out."""
        row = features_by_group(torch.from_numpy(self.inputs)).tolist()
        return {name: round(value, 3) for name, value in zip(FEATURES, row, strict=True) if value > 0}

    @property
    def color(self) -> str:
        """The strongest colour, "grey" where there is none."""
        colors = self.inputs[7:]
        return FEATURES[7 + int(colors.argmax())] if colors.max() > 0 else "grey"

    def add(self, time: float, seen: Sighting) -> None:
        """Take another sighting."""
        if self.path:
            last, row, column, _ = self.path[-1]
            gap = time - last
            share = gap / (0.4 + gap)
            moved = ((seen.place[0] - row) / gap, (seen.place[1] - column) / gap)
            self.velocity = (
                self.velocity[0] + share * (moved[0] - self.velocity[0]),
                self.velocity[1] + share * (moved[1] - self.velocity[1]),
            )
        self.path.append((time, *seen.place, seen.strength))
        self.heading = self.heading + seen.motion / max(float(np.hypot(*seen.motion)), 1e-12)
        self.outputs, self.inputs = self.outputs + seen.outputs, self.inputs + seen.inputs
        self.winners[int(seen.outputs.argmax())] += 1
        self.fields = seen.fields

    def expected(self, time: float) -> tuple[float, float]:
        """Row and column it should have reached."""
        last, row, column, _ = self.path[-1]
        return row + self.velocity[0] * (time - last), column + self.velocity[1] * (time - last)


class ObjectFiles:
    """Turns field signals and the network's outputs into objects, one time step after the other.

    Args:
        dt: seconds between time steps.
        aspect: width of the picture over its height.
        criteria, seen: see there.
    """

    def __init__(
        self, dt: float, aspect: float, criteria: FileCriteria | None = None, seen: SightingCriteria | None = None
    ) -> None:
        self.dt, self.aspect = dt, aspect
        self.criteria, self.seen = criteria or FileCriteria(), seen or SightingCriteria()
        self.open: list[ObjectFile] = []
        self.closed: list[ObjectFile] = []
        self._motion: Tensor | None = None
        self._strongest = 0.0

    def add(self, fields: FieldSignals, inputs: Tensor, outputs: Tensor) -> list[list[tuple[ObjectFile, Sighting]]]:
        """Take a stretch of signals; returns which objects were in sight at each of its steps."""
        now: list[list[tuple[ObjectFile, Sighting]]] = []
        numbers = zip(fields.noise.tolist(), fields.time.tolist(), strict=True)
        steps = zip(fields.motion, inputs, outputs, fields.presence, numbers, strict=True)
        for motion, y, o, presence, (noise, time) in steps:
            self._motion = (
                motion
                if self._motion is None
                else torch.lerp(self._motion, motion, self.dt / (self.criteria.tau + self.dt))
            )
            if time < self.criteria.settle:
                now.append([])
                continue
            largest = float(strengths(self._motion.double().numpy()).max())
            self._strongest = max(self._strongest * math.exp(-self.dt / 20), largest)
            seen = sightings(self._motion, y, o, presence, noise, self._strongest, self.seen)
            now.append(self._follow(time, seen))
        return now

    def _follow(self, time: float, seen: list[Sighting]) -> list[tuple[ObjectFile, Sighting]]:
        """Give every sighting to the object it fits best, nearest first; new objects for the rest."""
        c = self.criteria
        late = [thing for thing in self.open if time - thing.disappeared > c.coast]
        self.closed += late
        self.open = [thing for thing in self.open if thing not in late]
        pairs = []
        for i, thing in enumerate(self.open):
            gate = c.gate + c.reach * min(time - thing.disappeared, 1.0)
            for j, sight in enumerate(seen):
                unlike = 1 - likeness(thing.outputs, sight.outputs)
                turned = (1 - cosine(thing.heading, sight.motion)) / 2
                cost = self.distance(thing.expected(time), sight.place) / gate + c.unlike * unlike + c.turn * turned
                if cost < 1:
                    pairs.append((cost, i, j))
        given: list[tuple[ObjectFile, Sighting]] = []
        taken_things: set[int] = set()
        taken: set[int] = set()
        for _, i, j in sorted(pairs):
            if i not in taken_things and j not in taken:
                taken_things.add(i)
                taken.add(j)
                self.open[i].add(time, seen[j])
                given.append((self.open[i], seen[j]))
        for j, sight in enumerate(seen):
            if j not in taken:
                thing = ObjectFile([], np.zeros(2), np.zeros(10), np.zeros(10), np.zeros(10))
                thing.add(time, sight)
                self.open.append(thing)
                given.append((thing, sight))
        return given

    def distance(self, a: tuple[float, float], b: tuple[float, float]) -> float:
        """Between two places, heights of the picture."""
        return math.hypot(a[0] - b[0], (a[1] - b[1]) * self.aspect)

    def objects(self) -> list[ObjectFile]:
        """The objects so far, in the order in which they appeared: what was in sight long enough, moved along and
        kept its direction; parts of one thing, and what came out again from behind something, joined."""
        good = [thing for thing in self.closed + self.open if self._stands(thing)]
        good.sort(key=lambda thing: -sum(strength for *_, strength in thing.path))
        kept: list[ObjectFile] = []
        for thing in good:
            same = next((k for k, other in enumerate(kept) if self._same(other, thing)), None)
            if same is None:
                kept.append(thing)
            else:
                kept[same] = joined(kept[same], thing)
        return sorted(kept, key=lambda thing: thing.appeared)

    def way(self, thing: ObjectFile) -> Floats:
        """From the first fifth of its path to the last, down and right, heights."""
        places = np.array([(row, column * self.aspect) for _, row, column, _ in thing.path])
        k = max(1, len(places) // 5)
        return np.asarray(places[-k:].mean(0) - places[:k].mean(0))

    def _stands(self, thing: ObjectFile) -> bool:
        c, n = self.criteria, len(thing.path)
        straight = float(np.hypot(*thing.heading)) / n
        return n * self.dt >= c.shortest and float(np.hypot(*self.way(thing))) >= c.travel and straight >= c.straight

    def _same(self, one: ObjectFile, other: ObjectFile) -> bool:
        """Whether two objects are parts of one, or one before and after it was hidden."""
        c = self.criteria
        if likeness(one.outputs, other.outputs) < c.alike or cosine(self.way(one), self.way(other)) < 0.7:
            return False
        places = {time: (row, column) for time, row, column, _ in one.path}
        apart = [self.distance(places[t], (row, column)) for t, row, column, _ in other.path if t in places]
        if len(apart) > 0.3 * len(other.path):
            return float(np.median(apart)) < c.beside
        first, second = (one, other) if one.appeared < other.appeared else (other, one)
        gap = second.appeared - first.disappeared
        seconds = max(first.disappeared - first.appeared, 0.3)
        down, right = self.way(first) / seconds * max(gap, 0.0)
        _, row, column, _ = first.path[-1]
        heading_for = (row + down, column + right / self.aspect)
        return gap < c.behind and self.distance(heading_for, second.path[0][1:3]) < c.return_


def joined(one: ObjectFile, other: ObjectFile) -> ObjectFile:
    """Both as one object."""
    path = {point[0]: point for point in other.path}
    path.update({point[0]: point for point in one.path})
    return ObjectFile(
        [path[time] for time in sorted(path)],
        one.heading + other.heading,
        one.outputs + other.outputs,
        one.inputs + other.inputs,
        one.winners + other.winners,
        one.velocity,
        one.fields,
    )
