"""What a localiser passes from step to step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.navigation.localisation.finding import Hunt
from ndtorch.navigation.localisation.parts import Parts
from ndtorch.navigation.localisation.walls import Floats
from ndtorch.navigation.localisation.wheels import Wheels
from ndtorch.navigation.odometry import Pose


class Entry(NamedTuple):
    """A scan and the way to it.

    Attributes:
        age: steps since the start, `[]`.
        reckoned: where dead reckoning had the car.
        seconds: of driving since the entry before, `[]`.
        points: of the body frame, and weights, `[n, 3]`.
        unsure: variances of way and turn since the entry before, `[2]`.
    """

    age: Tensor
    reckoned: Pose
    seconds: Tensor
    points: Tensor
    unsure: Tensor


class Trail(NamedTuple):
    """All entries since the start.

    Attributes:
        entries: in their order; those in which the car stood are left out.
        way, seconds: driven since the start, m, and since the last entry, s, `[]`.
        times: how often the trail was gone through, `[]`.
        again: the state of a localiser that goes through it; None while nothing does.
        reached: how many entries that has, `[]`.
    """

    entries: tuple[Entry, ...]
    way: Tensor
    seconds: Tensor
    times: Tensor
    again: LocaliserState | None
    reached: Tensor


class LocaliserState(NamedTuple):
    """State of `Localiser`; single numbers are float64 tensors `[]`.

    Attributes:
        walls: what was ranged, `[size, size, 6]`, see `walls`.
        pose: where the car is.
        reckoned: where dead reckoning, corrected by what is seen of the motion, says that it is.
        way, turned: metres driven since the last scan, without sign, and radians turned, with it.
        unsure: variances of both, `[2]`.
        wheels: what they say, and what is known of them.
        scale, bend, drift: of `reckoned`, as far as known: the shares by which it counts too much way and too much
            turning, and the radians that it adds to the heading each second of driving.
        doubt: covariance of x, y, heading, scale, bend and drift, `[6, 6]`.
        age: steps since the start.
        score: how well the last scan fitted, 0..1.
        hunt: the search for the place in a known map; None where there is none, or where it has been found.
        parts: of the building; None with a known map, which is not moved.
        trail: kept until it was gone through again for the last time; None from then on, and with a known map.
    """

    walls: Tensor
    pose: Pose
    reckoned: Pose
    way: Tensor
    turned: Tensor
    unsure: Tensor
    wheels: Wheels
    scale: Tensor
    bend: Tensor
    drift: Tensor
    doubt: Tensor
    age: Tensor
    score: Tensor
    hunt: Hunt | None = None
    parts: Parts | None = None
    trail: Trail | None = None


def number(value: float) -> Tensor:
    """A single number of the state."""
    return torch.tensor(value, dtype=torch.float64)


def floats(pose: Pose) -> tuple[float, float, float]:
    """A pose as numbers."""
    return float(pose.x), float(pose.y), float(pose.heading)


def odometer_of(state: LocaliserState) -> tuple[Floats, Floats]:
    """What is known of scale, bend and drift, and standard deviations, `[3]` each."""
    known = np.array((float(state.scale), float(state.bend), float(state.drift)))
    return known, np.sqrt(state.doubt.diagonal()[3:].numpy())


def fresh(state: LocaliserState) -> LocaliserState:
    """A state since whose last scan nothing was driven."""
    return state._replace(way=number(0.0), turned=number(0.0), unsure=torch.zeros_like(state.unsure))


def less_sure(state: LocaliserState, unsure: Tensor) -> LocaliserState:
    """A state whose way since the last scan, and that along its part, are known so much worse, variances `[2]`."""
    state = state._replace(unsure=state.unsure + unsure)
    if state.parts is None:
        return state
    driven = state.parts.driven
    return state._replace(parts=state.parts._replace(driven=driven._replace(unsure=driven.unsure + unsure)))
