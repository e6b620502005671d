"""Odometry between two poses, with its derivative by the errors of the odometer."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.navigation.localisation.pose_graph import EDGE, Floats, compose_poses

SIGMA_M, SIGMA_RATIO = 0.01, 0.003
"""Standard deviation of the position along an edge, m, and m per metre driven."""

SIGMA_RAD, SIGMA_RAD_PER_M, SIGMA_RAD_PER_RAD = 0.002, 0.0003, 0.001
"""Standard deviation of the heading along an edge, radians, radians per metre driven and radians per radian turned."""


class OdometryEdge(NamedTuple):
    """Odometry along an edge of the pose graph, corrected by the calibration known at the time.

    Attributes:
        pose: end in the frame of the beginning, `[3]`.
        jacobian: derivative of `pose` by scale, bend and drift, `[3, 3]`.
        calibration: mean scale, bend and drift that were applied, `[3]`.
        length, turned: driven distance, m, and sum of the absolute turns, radians.
        variance: of length and turn as far as they are known, `[2]`.
    """

    pose: Floats
    jacobian: Floats
    calibration: Floats
    length: float
    turned: float
    variance: Floats


def empty_edge() -> OdometryEdge:
    """Before anything was driven."""
    return OdometryEdge(np.zeros(3), np.zeros((3, 3)), np.zeros(3), 0.0, 0.0, np.zeros(2))


def integrate(
    edge: OdometryEdge, step: tuple[float, float, float], seconds: float, calibration: Floats
) -> OdometryEdge:
    """The edge after one more step of dead reckoning.

    Args:
        step: length, m, direction relative to the heading before it, and turn, radians.
        seconds: duration of driving.
        calibration: scale, bend and drift, `[3]`.
    """
    length, aside, turn = step
    scale, bend, drift = calibration.tolist()
    x, y, heading = edge.pose.tolist()
    (xs, xb, xd), (ys, yb, yd), (_, hb, hd) = edge.jacobian.tolist()
    true_turn = (turn - drift * seconds) * (1 - bend)
    direction = heading + aside + (true_turn - turn) / 2
    cos, sin = length * math.cos(direction), length * math.sin(direction)
    ahead, left = cos * (1 - scale), sin * (1 - scale)
    by_bend, by_drift = drift * seconds - turn, -seconds * (1 - bend)
    middle_b, middle_d = hb + by_bend / 2, hd + by_drift / 2
    jacobian = np.array(
        (
            (xs - cos, xb - left * middle_b, xd - left * middle_d),
            (ys - sin, yb + ahead * middle_b, yd + ahead * middle_d),
            (0.0, hb + by_bend, hd + by_drift),
        )
    )
    total = edge.length + length
    share = length / total if total > 0 else 1.0
    mean = edge.calibration + share * (calibration - edge.calibration)
    pose = np.array((x + ahead, y + left, heading + true_turn))
    return OdometryEdge(pose, jacobian, mean, total, edge.turned + abs(turn), edge.variance)


def compose(first: OdometryEdge, second: OdometryEdge) -> OdometryEdge:
    """Two consecutive edges as one."""
    begin, end = first.pose, second.pose
    cos, sin = math.cos(begin[2]), math.sin(begin[2])
    pose = compose_poses(begin, end)
    lever = np.array(((1.0, 0.0, begin[1] - pose[1]), (0.0, 1.0, pose[0] - begin[0]), (0.0, 0.0, 1.0)))
    turn = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
    length = first.length + second.length
    return OdometryEdge(
        pose,
        lever @ first.jacobian + turn @ second.jacobian,
        (first.calibration * first.length + second.calibration * second.length) / max(length, 1e-9),
        length,
        first.turned + second.turned,
        first.variance + second.variance,
    )


def odometry_constraints(edges: list[OdometryEdge]) -> tuple[Floats, Floats]:
    """Edges `[K, 11]` of consecutive poses as if scale, bend and drift were zero, and their derivatives `[K, 3, 3]`."""
    length = np.array([edge.length for edge in edges])
    turned = np.array([edge.turned for edge in edges])
    variance = np.stack([edge.variance for edge in edges])
    jacobian = np.stack([edge.jacobian for edge in edges])
    calibration = np.stack([edge.calibration for edge in edges])
    rows = np.zeros((len(edges), EDGE))
    rows[:, 0] = np.arange(len(edges))
    rows[:, 1] = rows[:, 0] + 1
    rows[:, 2:5] = np.stack([edge.pose for edge in edges]) - (jacobian @ calibration[..., None])[..., 0]
    precision = 1 / ((SIGMA_M + SIGMA_RATIO * length) ** 2 + variance[:, 0])
    rows[:, 5], rows[:, 7] = precision, precision
    sigma = SIGMA_RAD + SIGMA_RAD_PER_M * length + SIGMA_RAD_PER_RAD * turned
    rows[:, 10] = 1 / (sigma**2 + variance[:, 1])
    return rows, jacobian
