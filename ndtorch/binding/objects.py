"""Objects: their table in learned weights, the one type of object that every model gives, and their words. [C §4.1]"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.arguments import check_tensor
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.errors import InputError
from ndtorch.vision.features import FEATURES, GROUPS

# The feature of motion along an axis: towards larger and towards smaller places.
ACROSS, ALONG = ("right", "left"), ("down", "up")


class ObjectTable(NamedTuple):
    """The objects of one network or a batch of them: what every read-out gives.

    Attributes:
        owners: neurons that stand for an object, `[..., N]`, bool.
        rows: row k holds the features of the object of neuron k, zeros where k owns none, `[..., N, N]`. The rows of
            owners, in order, are the matrix O of [C eq. 9], and their numbers the vector r of eq. 10.
    """

    owners: Tensor
    rows: Tensor


def features_by_group(values: Tensor, smallest: float = 1 / 3) -> Tensor:
    """Each group of features over its own largest, negative and small ones removed, `[..., 10]`."""
    positive = values.clamp_min(0)
    shares = divide(positive, spread_groups(group_max(positive)))
    return torch.where(shares >= smallest, shares, 0.0)


def simplified(weights: Tensor, smallest_weight: float = 1 / 3) -> Tensor:
    """Weights `[..., N, N]` over the largest of them, those under `smallest_weight` removed. [C eq. 6-7]"""
    if weights.ndim < 2 or weights.shape[-1] != weights.shape[-2]:
        raise InputError(f"weights must be square matrices [..., N, N], got {tuple(weights.shape)}")
    largest = weights.amax((-1, -2), keepdim=True).clamp_min(torch.finfo(weights.dtype).tiny)
    normed = weights / largest
    return torch.where(normed >= smallest_weight, normed, 0.0)


def object_table(weights: Tensor, smallest_weight: float = 1 / 3, smallest_column: float = 0.6) -> ObjectTable:
    """Read the objects out of second-stage weights `[..., N, N]`. [C eq. 6-10]

    A neuron owns an object when the weights it sends, after normalisation to the largest weight and removal of
    those under `smallest_weight`, sum to more than `smallest_column`. All zero weights give no object.

    >>> weights = torch.zeros(10, 10)
    >>> weights[1, 7] = weights[4, 7] = 0.8  # from red to right and to 0°
    >>> object_table(weights).owners.nonzero().tolist()
    [[7]]
    """
    check_tensor("weights", weights)
    kept = simplified(weights, smallest_weight)
    owners = kept.sum(-2) > smallest_column
    own = torch.eye(weights.shape[-1], dtype=weights.dtype, device=weights.device)
    return ObjectTable(owners, torch.where(owners.unsqueeze(-1), kept.mT + own, 0.0))


@dataclass(frozen=True)
class BoundObject:
    """One object: its features, and where and when it was seen if the model knows that.

    Attributes:
        neuron: name of the neuron that stands for it, one of `FEATURES`.
        index: that neuron's number, 0 to 9.
        features: strength of every feature it has.
        place: column and row in pixels of the frames, x to the right and y down.
        velocity: pixels a second, to the right and down.
        first_seen, last_seen: seconds since the first frame.
        track: number of the track that follows it.
        number: among the objects of a run, from 1 in the order in which they appeared; None before it is known.
        heading: sum of the directions it was seen to move in, to the right and down, as unit vectors.
        fields: number of receptive fields that show it at its latest sighting.
        path: time, column and row of every sighting, where they are kept.
        color_name: "white", "grey", "black" or the nearest of six hues of its mean color; None of models without.
        boxes: left, top, right and bottom at every sighting of the path, pixels of the frames; empty of models without.
        confidence: probability that an object of these features is in view; None of models that do not say.
        states: of every sighting: "tentative" (not yet known to be an object), "measured", "predicted" (in a shared
            blob) or "stationary"; empty of models without.
    """

    neuron: str
    index: int
    features: dict[str, float]
    place: tuple[float, float] | None = None
    velocity: tuple[float, float] | None = None
    first_seen: float | None = None
    last_seen: float | None = None
    track: int | None = None
    heading: tuple[float, float] | None = None
    fields: int | None = None
    path: tuple[tuple[float, float, float], ...] = ()
    color_name: str | None = None
    boxes: tuple[tuple[float, float, float, float], ...] = ()
    number: int | None = None
    confidence: float | None = None
    states: tuple[str, ...] = ()

    @property
    def box(self) -> tuple[float, float, float, float] | None:
        """Left, top, right and bottom at its latest sighting, pixels of the frames; None of models without."""
        return self.boxes[-1] if self.boxes else None

    @property
    def color(self) -> str:
        """Name of its mean color, else its strongest color, "grey" where it has none."""
        return self.color_name or strongest(self.features, FEATURES[GROUPS["color"]]) or "grey"

    @property
    def direction(self) -> str | None:
        """The main one of left, right, down and up: of its heading, else of its motion features; None without any, or
        where it walked more than twice as far as it got."""
        if self.heading is None:
            return strongest(self.features, FEATURES[GROUPS["motion"]])
        steps = self.path[:: max(1, len(self.path) // 40)]  # longer ones than the noise of places
        walked = sum(math.dist(a[1:], b[1:]) for a, b in itertools.pairwise(steps))
        if steps and 2 * math.dist(steps[0][1:], steps[-1][1:]) < walked:
            return None
        right, down = self.heading
        positive, negative = ACROSS if abs(right) > abs(down) else ALONG
        return positive if max(right, down, key=abs) > 0 else negative

    def __str__(self) -> str:
        return describe(self)


def strongest(features: dict[str, float], names: tuple[str, ...]) -> str | None:
    """The strongest of those features, the first of equals; None where there is none of them."""
    there = [name for name in names if features.get(name, 0.0) > 0]
    return max(there, key=lambda name: features[name], default=None)


def bound_objects(table: ObjectTable, confidence: Tensor | float | None = None) -> list[BoundObject]:
    """The objects in the table of one network, in the order of their neurons. [C §4.1]

    Args:
        table: of one network of ten neurons.
        confidence: probability that an object of these features is in view; None where it is not known.

    Raises:
        InputError: a table of a batch, or not of the ten features.

    >>> from ndtorch.binding import object_table
    >>> weights = torch.zeros(10, 10)
    >>> weights[1, 7] = weights[4, 7] = 0.8
    >>> bound_objects(object_table(weights))[0].features
    {'right': 1.0, '0°': 1.0, 'red': 1.0}
    """
    if table.owners.shape != (len(FEATURES),):
        raise InputError(f"table must be of one network of ten neurons, got owners {tuple(table.owners.shape)}")
    found, sure = [], None if confidence is None else round(float(confidence), 3)
    for k in table.owners.nonzero().flatten().tolist():
        row = table.rows[k].tolist()
        features = {n: w for n, w in zip(FEATURES, row, strict=True) if w > 0}
        found.append(BoundObject(FEATURES[k], k, features, confidence=sure))
    return found


def describe(thing: BoundObject) -> str:
    """The object in words: "red, moving right and down, orientation between 0° and 120°".

    >>> from ndtorch.binding import BoundObject
    >>> describe(BoundObject('red', 7, {'red': 1.0, 'right': 0.9, '0°': 0.8}))
    'red, moving right, orientation 0°'
    """

    def present(names: tuple[str, ...]) -> list[str]:
        """Names that the object has, strongest first."""
        return sorted((n for n in names if n in thing.features), key=lambda n: -thing.features[n])

    colors, directions = present(FEATURES[GROUPS["color"]]), present(FEATURES[GROUPS["motion"]])
    angles = [n for n in FEATURES[GROUPS["orientation"]] if n in thing.features]
    words = [" and ".join(colors) if colors else "no color of its own"]
    words.append("moving " + " and ".join(directions) if directions else "no direction of motion")
    some = ("orientation between " if len(angles) == 2 else "orientation ") + " and ".join(angles)
    words.append({0: "no orientation", 3: "every orientation"}.get(len(angles), some))
    return ", ".join(words)
