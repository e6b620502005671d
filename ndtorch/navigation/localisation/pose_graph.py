"""Pose graph optimisation: Gauss-Newton on relative poses with robust weights, and marginal covariances."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

EDGE = 11
"""Columns of an edge: two pose indices, x, y and heading of the second in the frame of the first, and six of the
information matrix: xx, xy, yy, xh, yh, hh."""

OUTLIER_GATE = 16.0
"""Squared Mahalanobis distance at which an edge has a quarter of its weight."""


def wrap_angle(angle: Floats) -> Floats:
    """Angles in -pi..pi."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def relative_pose(base: Floats, pose: Floats) -> Floats:
    """Poses `[..., 3]` in the frames of `base`."""
    dx, dy = pose[..., 0] - base[..., 0], pose[..., 1] - base[..., 1]
    cos, sin = np.cos(base[..., 2]), np.sin(base[..., 2])
    return np.stack((cos * dx + sin * dy, cos * dy - sin * dx, wrap_angle(pose[..., 2] - base[..., 2])), -1)


def compose_poses(base: Floats, pose: Floats) -> Floats:
    """The inverse of `relative_pose`: poses `[..., 3]` of the frames `base`, in the world."""
    cos, sin = np.cos(base[..., 2]), np.sin(base[..., 2])
    x = base[..., 0] + cos * pose[..., 0] - sin * pose[..., 1]
    y = base[..., 1] + sin * pose[..., 0] + cos * pose[..., 1]
    return np.stack((x, y, base[..., 2] + pose[..., 2]), -1)


def information_matrix(six: Floats) -> Floats:
    """Symmetric matrices `[..., 3, 3]` from xx, xy, yy, xh, yh, hh `[..., 6]`."""
    return six[..., [0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(*six.shape[:-1], 3, 3)


class Constraints(NamedTuple):
    """Edges of the graph as arrays.

    Attributes:
        first, second: indices of poses, `[E]` each.
        measure, information: relative poses `[E, 3]` and `[E, 3, 3]`.
        common_jacobian: derivative of the measures by parameters that all edges share, `[E, 3, P]`.
    """

    first: npt.NDArray[np.int64]
    second: npt.NDArray[np.int64]
    measure: Floats
    information: Floats
    common_jacobian: Floats


def constraints(edges: Floats, common_jacobian: Floats | None = None) -> Constraints:
    """Constraints of edges `[E, 11]`."""
    common = np.zeros((len(edges), 3, 0)) if common_jacobian is None else common_jacobian
    first, second = edges[:, 0].astype(np.int64), edges[:, 1].astype(np.int64)
    return Constraints(first, second, edges[:, 2:5], information_matrix(edges[:, 5:]), common)


def jacobians(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Derivatives of `relative_pose(a, b)` by `a` and by `b`, `[E, 3, 3]` each."""
    cos, sin = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    by_b = np.zeros((len(a), 3, 3))
    by_b[:, 0, 0], by_b[:, 0, 1], by_b[:, 1, 0], by_b[:, 1, 1], by_b[:, 2, 2] = cos, sin, -sin, cos, 1.0
    by_a = -by_b
    by_a[:, 0, 2], by_a[:, 1, 2] = cos * dy - sin * dx, -cos * dx - sin * dy
    return by_a, by_b


def normal_equations(
    poses: Floats, c: Constraints, gate: float, common: Floats, sigma: Floats
) -> tuple[Floats, Floats]:
    """Matrix `[n, n]` and right side `[n]` of a Gauss-Newton step: three unknowns a pose, then the common parameters.

    See `gauss_newton_step` for the arguments.
    """
    prior = sigma**-2.0
    a, b = poses[c.first], poses[c.second]
    error = relative_pose(a, b) - c.measure - c.common_jacobian @ common
    error[:, 2] = wrap_angle(error[:, 2])
    by_a, by_b = jacobians(a, b)
    distance = np.einsum("ei,eij,ej->e", error, c.information, error)
    weighted = c.information / (1 + distance / gate)[:, None, None] ** 2
    size = 3 * len(poses) + len(common)
    three, shared = np.arange(3), np.broadcast_to(np.arange(3 * len(poses), size), (len(a), len(common)))
    where = np.concatenate((3 * c.first[:, None] + three, 3 * c.second[:, None] + three, shared), 1)
    jacobian = np.concatenate((by_a, by_b, -c.common_jacobian), 2)
    half = jacobian.transpose(0, 2, 1) @ weighted
    right = np.zeros(size)
    np.add.at(right, where, -(half @ error[:, :, None])[:, :, 0])
    right[size - len(common) :] -= prior * common
    matrix = np.zeros((size, size))
    np.add.at(matrix, (where[:, :, None], where[:, None, :]), half @ jacobian)
    damping = np.full(size, 1e-6)
    damping[size - len(common) :] += prior
    matrix[np.arange(size), np.arange(size)] += damping
    return matrix, right


def gauss_newton_step(
    poses: Floats, c: Constraints, gate: float, common: Floats | None = None, sigma: Floats | None = None
) -> tuple[Floats, Floats]:
    """Poses and common parameters after one Gauss-Newton step, in which the first pose is fixed.

    Args:
        poses: `[K, 3]`.
        c: the constraints.
        gate: squared Mahalanobis distance at which an edge has a quarter of its weight.
        common, sigma: parameters that the measures depend on, `[P]`, and their standard deviations around zero.
    """
    common = np.zeros(0) if common is None else common
    matrix, right = normal_equations(poses, c, gate, common, np.zeros(0) if sigma is None else sigma)
    # A dense solver takes some milliseconds for a hundred poses.
    step = np.concatenate((np.zeros(3), np.linalg.solve(matrix[3:, 3:], right[3:])))
    return poses + step[: 3 * len(poses)].reshape(-1, 3), common + step[3 * len(poses) :]


def joint_covariance(poses: Floats, c: Constraints, gate: float, sigma: Floats) -> Floats:
    """Covariance of all poses relative to the first, `[3 K, 3 K]`; see `gauss_newton_step` for the arguments."""
    matrix, _ = normal_equations(poses, c, gate, np.zeros(len(sigma)), sigma)
    size = 3 * len(poses)
    covariance = np.zeros((size, size))
    covariance[3:, 3:] = np.linalg.inv(matrix[3:, 3:])[: size - 3, : size - 3]
    return covariance


def marginal_covariances(
    poses: Floats, c: Constraints, gate: float, sigma: Floats, one: int, others: npt.NDArray[np.int64]
) -> Floats:
    """Covariances `[n, 3, 3]` of one pose in the frames of others."""
    blocks = joint_covariance(poses, c, gate, sigma).reshape(len(poses), 3, len(poses), 3).transpose(0, 2, 1, 3)
    by_a, by_b = jacobians(poses[others], poses[np.full(len(others), one)])
    cross = by_a @ blocks[others, one] @ by_b.transpose(0, 2, 1)
    own = by_a @ blocks[others, others] @ by_a.transpose(0, 2, 1) + by_b @ blocks[one, one] @ by_b.transpose(0, 2, 1)
    found: Floats = own + cross + cross.transpose(0, 2, 1)
    return found
