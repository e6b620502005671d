"""What was driven from one place to another, and how it would have been with another odometer."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.navigation.localisation.graph import FULL, carried
from ndtorch.navigation.localisation.params import PartParams
from ndtorch.navigation.localisation.walls import Floats


class Way(NamedTuple):
    """What was driven, by dead reckoning without its errors as far as they were known then.

    Attributes:
        pose: its end as seen from its beginning, `[3]`.
        change: of `pose` with scale, bend and drift, `[3, 3]`.
        known: scale, bend and drift with which it was reckoned, on average, `[3]`.
        length, turned: m, and radians without sign, `[]`.
        unsure: variances of the length and of the turn, as far as they are known, `[2]`.
    """

    pose: Tensor
    change: Tensor
    known: Tensor
    length: Tensor
    turned: Tensor
    unsure: Tensor


def no_way() -> Way:
    """Before anything was driven."""
    zeros = torch.zeros(3, 3, dtype=torch.float64)
    return Way(zeros[0], zeros, zeros[0], zeros[0, 0], zeros[0, 0], zeros[0, :2])


def drive_on(
    way: Way, reckoned: tuple[float, float, float], seconds: float, odometer: tuple[float, float, float]
) -> Way:
    """After a step by dead reckoning: length, direction off the heading before it, and turning.

    Args:
        odometer: scale, bend and drift as far as known.
    """
    length, aside, turn = reckoned
    scale, bend, drift = odometer
    x, y, heading = way.pose.tolist()
    (xs, xb, xd), (ys, yb, yd), (_, hb, hd) = way.change.tolist()
    true_turn = (turn - drift * seconds) * (1 - bend)
    direction = heading + aside + (true_turn - turn) / 2
    cos, sin = length * math.cos(direction), length * math.sin(direction)
    ahead, left = cos * (1 - scale), sin * (1 - scale)
    by_bend, by_drift = drift * seconds - turn, -seconds * (1 - bend)
    middle_b, middle_d = hb + by_bend / 2, hd + by_drift / 2
    change = (
        (xs - cos, xb - left * middle_b, xd - left * middle_d),
        (ys - sin, yb + ahead * middle_b, yd + ahead * middle_d),
        (0.0, hb + by_bend, hd + by_drift),
    )
    far = float(way.length) + length
    share = length / far if far > 0 else 1.0
    known = [before + share * (now - before) for before, now in zip(way.known.tolist(), odometer, strict=True)]
    places = torch.tensor(((x + ahead, y + left, heading + true_turn), known), dtype=torch.float64)
    lengths = places.new_tensor((far, float(way.turned) + abs(turn)))
    return Way(places[0], places.new_tensor(change), places[1], lengths[0], lengths[1], way.unsure)


def one_way(first: Way, second: Way) -> Way:
    """Two ways, one after the other, as one."""
    begin, end = first.pose.numpy(), second.pose.numpy()
    cos, sin = math.cos(begin[2]), math.sin(begin[2])
    pose = carried(begin, end)
    lever = np.array(((1.0, 0.0, begin[1] - pose[1]), (0.0, 1.0, pose[0] - begin[0]), (0.0, 0.0, 1.0)))
    turn = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
    length = first.length + second.length
    return Way(
        torch.from_numpy(pose),
        torch.from_numpy(lever @ first.change.numpy() + turn @ second.change.numpy()),
        (first.known * first.length + second.known * second.length) / length.clamp_min(1e-9),
        length,
        first.turned + second.turned,
        first.unsure + second.unsure,
    )


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
