"""Where something moves right now: neighbouring fields that show the same are one detection."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from ndtorch.binding.tracking.params import TrackParams
from ndtorch.vision.camera.colors import SHADES
from ndtorch.vision.features import FEATURES, GROUPS

SHADED = slice(len(FEATURES), len(FEATURES) + len(SHADES))
"""White, grey and black in what a detection keeps of its fields; how much has a hue comes after them."""

Floats = npt.NDArray[np.float64]


@dataclass
class Detection:
    """One thing at one moment.

    Attributes:
        place: row and column, shares of the picture's height and width.
        strength: of its strongest field.
        motion: opponent motion to the right and downward, summed over its fields.
        outputs: the network's outputs, and white, grey, black and hued, summed over its fields, `[14]`.
        inputs: the same of the network's inputs.
        fields: numbers of its fields.
    """

    place: tuple[float, float]
    strength: float
    motion: Floats
    outputs: Floats
    inputs: Floats
    fields: list[int]


def strengths(motion: Floats) -> Floats:
    """Root of the opponent motion of every field, `[R, C, 2]` -> `[R, C]`."""
    return np.asarray(np.sqrt(np.hypot(motion[..., 0], motion[..., 1])))


def detections(
    motion: Floats,
    inputs: Floats,
    outputs: Floats,
    presence: Floats,
    noise: float,
    strongest: float,
    criteria: TrackParams | None = None,
) -> list[Detection]:
    """Detections of one moment, strongest first.

    Fields are taken in the order of their strength; each joins the strongest of its eight neighbours already taken,
    or starts a detection of its own (inhibition of the weaker by the stronger neighbour). Then detections that touch
    and show the same are joined: a thing larger than a field is one thing. Fields that are filled by something that
    does not move only tell what hangs together.

    Args:
        motion: `[R, C, 2]`, averaged over a tenth of a second or so.
        inputs, outputs: of the network, then white, grey, black and hued, `[R * C, 14]`.
        presence: share of every field in which something stands out, `[R, C]`.
        noise: what a pixel's difference from the background had to pass.
        strongest: strength of the strongest field in the recent past.
        criteria: see there.
    """
    c = criteria or TrackParams()
    strength = strengths(motion)
    rows, columns = strength.shape
    floor = max(c.faint, c.noisy * noise, c.relative * strongest)
    filled = presence.reshape(-1).tolist()
    flat, weights = motion.reshape(-1, 2), strength.reshape(-1)
    size: list[float] = weights.tolist()
    active = [i for i in np.argsort(-weights).tolist() if size[i] > floor or filled[i] > c.filled]
    if not active or size[active[0]] <= floor:
        return []
    owner: dict[int, int] = {}
    members: dict[int, list[int]] = {}
    touching: dict[tuple[int, int], bool] = {}
    for i in active:
        near = [j for j in neighbours(i, rows, columns) if j in owner]
        peak = owner[max(near, key=lambda j: size[j])] if near else i
        owner[i] = peak
        members.setdefault(peak, []).append(i)
        for other in {owner[j] for j in near} - {peak}:
            pair = (min(peak, other), max(peak, other))
            level = size[i] >= c.saddle * min(size[peak], size[other]) or filled[i] >= c.filled
            touching[pair] = touching.get(pair, False) or level
    for (one, other), level in touching.items():
        a, b = find(owner, one), find(owner, other)
        if a == b or not level:
            continue
        first, second = moving(members[a], size, floor), moving(members[b], size, floor)
        if not first or not second:
            continue
        same = likeness(outputs[first].sum(0), outputs[second].sum(0)) >= c.same_color
        if same and cosine(flat[first].sum(0), flat[second].sum(0)) >= c.same_way:
            strong, weak = (a, b) if size[a] >= size[b] else (b, a)
            members[strong] += members.pop(weak)
            owner[weak] = strong
    found = []
    for peak, every in members.items():
        fields = moving(every, size, floor)
        if not fields:
            continue
        weight = weights[fields] ** 2
        r = float(((np.array(fields) // columns + 0.5) * weight).sum() / weight.sum() / rows)
        q = float(((np.array(fields) % columns + 0.5) * weight).sum() / weight.sum() / columns)
        found.append(
            Detection((r, q), size[peak], flat[fields].sum(0), outputs[fields].sum(0), inputs[fields].sum(0), fields)
        )
    return sorted(found, key=lambda s: -s.strength)


def moving(fields: list[int], size: list[float], floor: float) -> list[int]:
    """Those of the fields that show motion."""
    return [i for i in fields if size[i] > floor]


def find(owner: dict[int, int], i: int) -> int:
    """The detection that `i` belongs to after joining."""
    while owner[i] != i:
        i = owner[i]
    return i


@cache
def neighbours(i: int, rows: int, columns: int) -> list[int]:
    """Numbers of the up to eight fields around field `i`."""
    r, c = divmod(i, columns)
    return [
        y * columns + x
        for y in range(max(0, r - 1), min(rows, r + 2))
        for x in range(max(0, c - 1), min(columns, c + 2))
        if (y, x) != (r, c)
    ]


def likeness(a: Floats, b: Floats) -> float:
    """Cosine of two things' colors, as the network puts them out, or of shades of grey where neither has a hue.

    Motion is compared by itself, and things as small as a field have every orientation.
    """
    if shaded(a) and shaded(b):
        return cosine(a[SHADED], b[SHADED])
    return cosine(a[GROUPS["color"]], b[GROUPS["color"]])


def shaded(signals: Floats) -> bool:
    """Whether something is white, grey or black more than it has a hue."""
    return len(signals) > SHADED.stop and bool(signals[SHADED].max() > signals[SHADED.stop])


def cosine(a: Floats, b: Floats) -> float:
    """Cosine of the angle between two vectors, 0 where one of them is zero."""
    size = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / size if size > 0 else 0.0
