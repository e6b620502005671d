"""From the second stage's weights to the objects in view and their features."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.vision.features import FEATURES

SMALLEST_WEIGHT = 1 / 3
SMALLEST_COLUMN = 0.6


class ObjectTable(NamedTuple):
    """The read-out of [C §4.1] for one weight matrix or a batch of them.

    Attributes:
        simplified: weights over their maximum, small ones removed, `[..., N, N]`. [C eq. 6-7]
        owners: neurons that stand for an object, `[..., N]`, bool.
        rows: row k holds the features of the object of neuron k, zeros where k owns none, `[..., N, N]`. The
            rows of owners, in order, are the matrix O of [C eq. 9], and their numbers the vector r of eq. 10.
    """

    simplified: Tensor
    owners: Tensor
    rows: Tensor


def object_table(
    weights: Tensor, smallest_weight: float = SMALLEST_WEIGHT, smallest_column: float = SMALLEST_COLUMN
) -> ObjectTable:
    """Read the objects out of second-stage weights `[..., N, N]`. [C eq. 6-10]

    A neuron owns an object when the weights it sends, after normalisation to the largest weight and removal of
    those under `smallest_weight`, sum to more than `smallest_column`. All zero weights give no object.
    """
    if weights.ndim < 2 or weights.shape[-1] != weights.shape[-2]:
        raise InputError(f"weights must be square matrices [..., N, N], got {tuple(weights.shape)}")
    largest = weights.amax((-1, -2), keepdim=True).clamp_min(torch.finfo(weights.dtype).tiny)
    normed = weights / largest
    simplified = torch.where(normed >= smallest_weight, normed, 0.0)
    owners = simplified.sum(-2) > smallest_column
    own = torch.eye(weights.shape[-1], dtype=weights.dtype, device=weights.device)
    rows = torch.where(owners.unsqueeze(-1), simplified.mT + own, 0.0)
    return ObjectTable(simplified, owners, rows)


@dataclass(frozen=True)
class BoundObject:
    """One object in view.

    Attributes:
        neuron: name of the neuron that stands for it, one of `FEATURES`.
        index: that neuron's number, 0 to 9.
        features: weight of every feature the object has, its own neuron's being 1.
    """

    neuron: str
    index: int
    features: dict[str, float]

    def __str__(self) -> str:
        return describe(self)


def objects(weights: Tensor) -> list[BoundObject]:
    """The objects in one 10 x 10 weight matrix, in the order of their neurons. [C §4.1]"""
    if weights.shape != (len(FEATURES), len(FEATURES)):
        raise InputError(f"weights must be one 10 x 10 matrix, got {tuple(weights.shape)}")
    table = object_table(weights)
    found = []
    for k in table.owners.nonzero().flatten().tolist():
        row = table.rows[k].tolist()
        found.append(BoundObject(FEATURES[k], k, {n: w for n, w in zip(FEATURES, row, strict=True) if w > 0}))
    return found


def describe(thing: BoundObject) -> str:
    """The object in words: "red, moving right and down, orientation between 0° and 120°"."""

    def present(names: tuple[str, ...]) -> list[str]:
        """Names that the object has, strongest first."""
        return sorted((n for n in names if n in thing.features), key=lambda n: -thing.features[n])

    colors, directions = present(FEATURES[7:]), present(FEATURES[:4])
    angles = [n for n in FEATURES[4:7] if n in thing.features]
    words = [" and ".join(colors) if colors else "no color of its own"]
    words.append("moving " + " and ".join(directions) if directions else "no direction of motion")
    if not angles:
        words.append("no orientation")
    elif len(angles) == 1:
        words.append(f"orientation {angles[0]}")
    elif len(angles) == 2:
        words.append(f"orientation between {angles[0]} and {angles[1]}")
    else:
        words.append("every orientation")
    return ", ".join(words)
