"""What the wheels say between two looks, corrected by what the rows say.

The wheels tell each step how far they have turned, wrongly by a share that changes from second to second where they
slip, and in bends by some more; the heading also drifts. An extended Kalman filter of these three numbers learns them
from what is seen, and weighs both. Where nothing is seen, the wheels are believed with what is known of them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.navigation.localisation.motion import Look, Motion, motion_seen
from ndtorch.navigation.localisation.params import MotionParams
from ndtorch.navigation.localisation.walls import Floats
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.rig import StereoRig


class Wheels(NamedTuple):
    """State.

    Attributes:
        said: the pose of dead reckoning by the wheels alone.
        since: what they said since the last look: way ahead, m, turn, radians, and time of driving, s, `[3]`.
        base: the corrected pose at the last look, `[3]`.
        errors: share of way and turn, share of turn, and radians a second, by which they count too much, `[3]`.
        doubt: covariance of these, `[3, 3]`.
        look: the last one; None where the car has not looked since it was put where it is.
    """

    said: Pose
    since: Tensor
    base: Tensor
    errors: Tensor
    doubt: Tensor
    look: Look | None


class Driven(NamedTuple):
    """Way and turn between two looks, m and radians, `[2]`, and their variances, `[2]`."""

    mean: Floats
    variance: Floats


def no_wheels(at: Pose, params: MotionParams) -> Wheels:
    """Before anything was driven."""
    p, base = params, torch.tensor([float(part) for part in at], dtype=torch.float64)
    doubt = torch.diag(base.new_tensor((p.scale, p.bend, p.drift)).square())
    return Wheels(at, torch.zeros_like(base), base, torch.zeros_like(base), doubt, None)


def carried_to(wheels: Wheels, at: Pose) -> Wheels:
    """The same wheels, at a pose to which the car was carried."""
    base = wheels.base.new_tensor([float(part) for part in at])
    return wheels._replace(said=at, since=torch.zeros_like(base), base=base, look=None)


def along(pose: Tensor, way: float, turn: float) -> Tensor:
    """A pose `[3]` after an arc, whose chord is taken for its length."""
    x, y, heading = pose.tolist()
    middle = heading + turn / 2
    return pose.new_tensor((x + way * math.cos(middle), y + way * math.sin(middle), heading + turn))


def rolled(wheels: Wheels, said: Pose, seconds: float) -> Wheels:
    """After a step by dead reckoning."""
    x, y, heading = (float(part) for part in said)
    ox, oy, before = (float(part) for part in wheels.said)
    turn = heading - before
    middle = before + turn / 2
    way = (x - ox) * math.cos(middle) + (y - oy) * math.sin(middle)
    if abs(way) < 1e-6 and abs(turn) < 1e-9:
        return wheels._replace(said=said)
    return wheels._replace(said=said, since=wheels.since + wheels.since.new_tensor((way, turn, seconds)))


def expected(wheels: Wheels) -> tuple[float, float]:
    """Way and turn since the last look by the wheels and what is known of them."""
    (way, turn, seconds), (share, bend, drift) = wheels.since.tolist(), wheels.errors.tolist()
    return way * (1 - share), (turn - drift * seconds) * (1 - share) * (1 - bend)


def corrected(wheels: Wheels) -> Pose:
    """Where they have led, corrected."""
    return Pose(*along(wheels.base, *expected(wheels)).unbind())


def are_known(wheels: Wheels, params: MotionParams) -> bool:
    """Whether seen motion has told their errors: what is known of the drift tells, which nothing else makes less."""
    return float(wheels.doubt[2, 2]) < (params.drift / 2) ** 2


def looked(wheels: Wheels, rows: Tensor, rig: StereoRig, params: MotionParams) -> tuple[Wheels, Tensor]:
    """The wheels after a look at both gray rows `[2, W]`, and the variances of way and turn since the last, `[2]`."""
    seen = None
    if wheels.look is not None and float(wheels.since[2]) > 0:
        seen = motion_seen(wheels.look, rows, expected(wheels), rig, params)
    wheels, driven = weighed(wheels, seen, params)
    return wheels, torch.from_numpy(driven.variance)


def weighed(wheels: Wheels, seen: Motion | None, params: MotionParams) -> tuple[Wheels, Driven]:
    """What was driven since the last look, and the wheels as they are known after it."""
    p = params
    (way, turn, seconds), (share, bend, drift) = wheels.since.tolist(), wheels.errors.tolist()
    guess = np.array(expected(wheels))
    noise = np.diag(((p.slip * way) ** 2 + p.still**2, (p.turn_slip * turn) ** 2 + p.turn_still**2))
    plain = turn - drift * seconds
    slope = np.array(
        ((-way, 0.0, 0.0), (-plain * (1 - bend), -plain * (1 - share), -seconds * (1 - share) * (1 - bend)))
    )
    doubt = wheels.doubt.numpy()
    if seconds:
        doubt = doubt + np.diag(np.square((p.scale_walk, p.bend_walk, p.drift_walk)))
        doubt[0, 0] = min(doubt[0, 0], p.scale**2)
    both = slope @ doubt @ slope.T + noise
    errors = wheels.errors.numpy()
    if seen is None:
        mean, left = guess, both
    else:
        off = seen.mean - guess
        for _ in range(3):
            far = float(off @ np.linalg.solve(both + seen.doubt, off))
            if far <= p.surprise:
                break
            noise = noise * far / p.surprise * 1.5  # the wheels have slipped
            both = slope @ doubt @ slope.T + noise
        gain = np.linalg.inv(both + seen.doubt)
        mean, left = guess + both @ gain @ off, both - both @ gain @ both
        learned = doubt @ slope.T @ gain
        errors, doubt = errors + learned @ off, doubt - learned @ slope @ doubt
        doubt = (doubt + doubt.T) / 2
    wheels = wheels._replace(
        since=torch.zeros_like(wheels.since),
        base=along(wheels.base, *mean.tolist()),
        errors=torch.from_numpy(errors),
        doubt=torch.from_numpy(doubt),
    )
    return wheels, Driven(mean, np.diagonal(left).copy())
