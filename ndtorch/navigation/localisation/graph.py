"""The poses that fit what is known of pairs of them best: a pose graph."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[Any]

HEADING, FULL = 5, 11
"""Columns of an edge: two numbers of poses, x, y and heading of the second as seen from the first, and six of the
information: xx, xy, yy, xh, yh, hh."""


class Links(NamedTuple):
    """Edges as a solver wants them.

    Attributes:
        first, second: pairs, `[E]` each.
        measure, information: `[E, 3]` and `[E, 3, 3]`.
        change: of the measures with numbers that all edges have in common, `[E, 3, P]`.
    """

    first: npt.NDArray[np.int64]
    second: npt.NDArray[np.int64]
    measure: Floats
    information: Floats
    change: Floats


def links_of(edges: Floats, change: Floats | None = None) -> Links:
    """Edges `[E, 11]` taken apart."""
    change = np.zeros((len(edges), 3, 0)) if change is None else change
    square = edges[:, [5, 6, 8, 6, 7, 9, 8, 9, 10]].reshape(-1, 3, 3)
    return Links(edges[:, 0].astype(np.int64), edges[:, 1].astype(np.int64), edges[:, 2:HEADING], square, change)


def wrapped(angle: Floats) -> Floats:
    """Angles, radians, within half a turn."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def seen_from(base: Floats, pose: Floats) -> Floats:
    """Poses `[..., 3]` in the frames of other ones."""
    dx, dy = pose[..., 0] - base[..., 0], pose[..., 1] - base[..., 1]
    cos, sin = np.cos(base[..., 2]), np.sin(base[..., 2])
    return np.stack((cos * dx + sin * dy, cos * dy - sin * dx, wrapped(pose[..., 2] - base[..., 2])), -1)


def carried(base: Floats, pose: Floats) -> Floats:
    """The opposite: poses `[..., 3]` of the frames of other ones, in the world."""
    cos, sin = np.cos(base[..., 2]), np.sin(base[..., 2])
    x = base[..., 0] + cos * pose[..., 0] - sin * pose[..., 1]
    y = base[..., 1] + sin * pose[..., 0] + cos * pose[..., 1]
    return np.stack((x, y, base[..., 2] + pose[..., 2]), -1)


class Normal(NamedTuple):
    """Normal equations of one step of Gauss-Newton: `matrix` `[n, n]` and right side `[n]`, three unknowns of every
    pose, then what is common."""

    matrix: Floats
    right: Floats


def normal_equations(poses: Floats, links: Links, gate: float, common: Floats, doubt: Floats) -> Normal:
    """The equations at these poses; for the arguments see `relax`."""
    trust = doubt**-2.0
    a, b = poses[links.first], poses[links.second]
    off = seen_from(a, b) - links.measure - links.change @ common
    off[:, 2] = wrapped(off[:, 2])
    to_a, to_b = slopes(a, b)
    distance = np.einsum("ei,eij,ej->e", off, links.information, off)
    weighed = links.information / (1 + distance / gate)[:, None, None] ** 2
    size = 3 * len(poses) + len(common)
    three, shared = np.arange(3), np.broadcast_to(np.arange(3 * len(poses), size), (len(a), len(common)))
    where = np.concatenate((3 * links.first[:, None] + three, 3 * links.second[:, None] + three, shared), 1)
    slope = np.concatenate((to_a, to_b, -links.change), 2)
    half = slope.transpose(0, 2, 1) @ weighed
    right = np.zeros(size)
    np.add.at(right, where, -(half @ off[:, :, None])[:, :, 0])
    right[size - len(common) :] -= trust * common
    matrix = np.zeros((size, size))
    np.add.at(matrix, (where[:, :, None], where[:, None, :]), half @ slope)
    little = np.full(size, 1e-6)
    little[size - len(common) :] += trust
    matrix[np.arange(size), np.arange(size)] += little
    return Normal(matrix, right)


def slopes(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """How poses `[E, 3]` as seen from others change with these, and with themselves, `[E, 3, 3]` each."""
    cos, sin = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    to_b = np.zeros((len(a), 3, 3))
    to_b[:, 0, 0], to_b[:, 0, 1], to_b[:, 1, 0], to_b[:, 1, 1], to_b[:, 2, 2] = cos, sin, -sin, cos, 1.0
    to_a = -to_b
    to_a[:, 0, 2], to_a[:, 1, 2] = cos * dy - sin * dx, -cos * dx - sin * dy
    return to_a, to_b


def relax(
    poses: Floats, links: Links, gate: float, common: Floats | None = None, doubt: Floats | None = None
) -> tuple[Floats, Floats]:
    """One step of Gauss-Newton; the first pose stays where it is.

    Args:
        poses: `[K, 3]`.
        gate: squared distance, in standard deviations, at which an edge counts a quarter.
        common, doubt: numbers that the measures depend on, `[P]`, and their standard deviations around zero.

    Returns:
        The poses and the numbers after it.
    """
    common = np.zeros(0) if common is None else common
    matrix, right = normal_equations(poses, links, gate, common, np.zeros(0) if doubt is None else doubt)
    # A hundred poses are solved in some milliseconds without a sparse solver, which would be one more package.
    step = np.concatenate((np.zeros(3), np.linalg.solve(matrix[3:, 3:], right[3:])))
    return poses + step[: 3 * len(poses)].reshape(-1, 3), common + step[3 * len(poses) :]


def covariance_of(poses: Floats, links: Links, gate: float, doubt: Floats) -> Floats:
    """Covariance of all poses as seen from the first, `[3 K, 3 K]`; for the arguments see `relax`."""
    matrix, _ = normal_equations(poses, links, gate, np.zeros(len(doubt)), doubt)
    size = 3 * len(poses)
    covariance = np.zeros((size, size))
    covariance[3:, 3:] = np.linalg.inv(matrix[3:, 3:])[: size - 3, : size - 3]
    return covariance


def doubts(poses: Floats, links: Links, gate: float, doubt: Floats, one: int, others: npt.NDArray[np.int64]) -> Floats:
    """How well one pose is known as seen from others: covariances `[n, 3, 3]`."""
    blocks = covariance_of(poses, links, gate, doubt).reshape(len(poses), 3, len(poses), 3).transpose(0, 2, 1, 3)
    to_a, to_b = slopes(poses[others], poses[np.full(len(others), one)])
    both = to_a @ blocks[others, one] @ to_b.transpose(0, 2, 1)
    apart = to_a @ blocks[others, others] @ to_a.transpose(0, 2, 1) + to_b @ blocks[one, one] @ to_b.transpose(0, 2, 1)
    found: Floats = apart + both + both.transpose(0, 2, 1)
    return found
