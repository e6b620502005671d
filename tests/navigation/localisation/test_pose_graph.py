"""Odometry edges, and poses that satisfy edges: exactly if these agree, and despite one that is wrong."""

import math

import numpy as np
import pytest

from ndtorch.navigation.localisation.odometry_edge import compose, empty_edge, integrate
from ndtorch.navigation.localisation.pose_graph import (
    compose_poses,
    constraints,
    gauss_newton_step,
    marginal_covariances,
    relative_pose,
)

RING = np.array(
    [(2 * math.sin(n / 8 * 2 * math.pi), 2 - 2 * math.cos(n / 8 * 2 * math.pi), n * 0.785) for n in range(8)]
)


def edges_between(pairs, wrong=0.0):
    rows = [(a, b, *relative_pose(RING[a], RING[b]), 400.0, 0.0, 400.0, 0.0, 0.0, 2500.0) for a, b in pairs]
    rows[-1] = (*rows[-1][:3], rows[-1][3] + wrong, *rows[-1][4:])
    return constraints(np.array(rows))


def relaxed(poses, closures, gate, rounds=12):
    for _ in range(rounds):
        poses, _ = gauss_newton_step(poses, closures, gate)
    return poses


def test_a_pose_seen_from_another_is_carried_back():
    a, b = np.array((1.0, -2.0, 2.5)), np.array((0.3, 4.0, 2.0))
    assert compose_poses(a, relative_pose(a, b)) == pytest.approx(b, abs=1e-12)
    assert relative_pose(np.array((0.0, 0.0, math.pi / 2)), np.array((0.0, 2.0, math.pi))) == pytest.approx(
        (2.0, 0.0, math.pi / 2)
    )


def test_a_bent_chain_is_pulled_straight_by_a_closed_loop():
    bent = RING + np.outer(np.arange(8), (0.05, -0.03, 0.04))
    closures = edges_between([(n, (n + 1) % 8) for n in range(8)])
    found = relaxed(bent, closures, gate=1e6)
    assert found[0] == pytest.approx(bent[0], abs=0)
    assert found == pytest.approx(RING, abs=1e-6)


def test_one_wrong_edge_is_outvoted():
    pairs = [(n, n + 1) for n in range(7)] + [(n, n + 2) for n in range(6)] + [(0, 7), (0, 5)]
    closures = edges_between(pairs, wrong=1.5)
    assert np.abs(relaxed(RING, closures, gate=16.0) - RING).max() < 0.03
    assert np.abs(relaxed(RING, closures, gate=1e9) - RING).max() > 0.1


def test_an_error_that_all_edges_share_is_found():
    pairs = [(n, (n + 1) % 8) for n in range(8)]
    closures = edges_between(pairs)
    stretch = np.zeros((8, 3, 1))
    stretch[:, :2, 0] = closures.measure[:, :2]
    closures = closures._replace(measure=closures.measure - 0.05 * stretch[:, :, 0], common_jacobian=stretch)
    more = edges_between([(0, 4), (2, 6)])
    closures = type(closures)(
        *(
            np.concatenate(part)
            for part in zip(closures, more._replace(common_jacobian=np.zeros((2, 3, 1))), strict=True)
        )
    )
    poses, common = RING, np.zeros(1)
    for _ in range(12):
        poses, common = gauss_newton_step(poses, closures, 1e6, common, np.array((1.0,)))
    assert common == pytest.approx(0.05, abs=1e-3)
    assert poses == pytest.approx(RING, abs=1e-3)


def test_how_well_a_pose_is_known_adds_up_along_a_chain_and_less_so_around_a_loop():
    chain = [(n, n + 1) for n in range(7)]
    nothing, others = np.zeros(0), np.array([0, 5])
    far, near = marginal_covariances(RING, edges_between(chain), 1e9, nothing, 7, others)
    # Two closures on, as seen from 5: both of 5 cm and 1/50, and the turn of the first at the arm of the second.
    arm = relative_pose(RING[5], RING[7]) - relative_pose(RING[5], RING[6])
    lever = np.array(((1.0, 0.0, -arm[1]), (0.0, 1.0, arm[0]), (0.0, 0.0, 1.0)))
    one = np.diag((1 / 400, 1 / 400, 1 / 2500))
    assert near == pytest.approx(lever @ one @ lever.T + one, abs=1e-5)
    closed = marginal_covariances(RING, edges_between([*chain, (0, 7)]), 1e9, nothing, 7, others)[0]
    assert far[2, 2] == pytest.approx(7 / 2500, rel=1e-2)
    assert closed[2, 2] < 1 / 2500 < far[2, 2]


def test_a_number_that_all_edges_share_makes_poses_less_sure():
    closures = edges_between([(n, n + 1) for n in range(4)])
    turn = closures._replace(common_jacobian=np.tile(np.array([[[0.0], [0.0], [1.0]]]), (4, 1, 1)))
    known, unknown = (
        marginal_covariances(RING[:5], turn, 1e9, np.array([d]), 4, np.array([0]))[0, 2, 2] for d in (1e-6, 0.1)
    )
    assert known == pytest.approx(4 / 2500, rel=1e-2)
    assert unknown == pytest.approx(4 / 2500 + 0.4**2, rel=1e-2)


DT = 0.2
STEPS = [(0.1, 0.0, 0.02), (0.12, 0.3, 0.0), (0.08, -0.2, -0.05)] * 4


def edge(steps, odometer):
    found = empty_edge()
    for step in steps:
        found = integrate(found, step, DT, odometer)
    return found


def test_a_way_knows_how_it_changes_with_the_errors_of_the_odometer():
    known, size = np.array((0.02, -0.01, 0.003)), 1e-5
    found = edge(STEPS, known)
    for n in range(3):
        change = np.zeros(3)
        change[n] = size
        ends = [edge(STEPS, known + s * change).pose for s in (1, -1)]
        assert found.jacobian[:, n] == pytest.approx((ends[0] - ends[1]) / (2 * size), rel=1e-4, abs=1e-6)


def test_two_ways_are_one():
    known = np.array((0.02, -0.01, 0.003))
    first, second = (edge(steps, known) for steps in (STEPS[:5], STEPS[5:]))
    first, second = (part._replace(variance=part.variance + n) for part, n in ((first, 1.0), (second, 2.0)))
    whole, both = edge(STEPS, known), compose(first, second)
    whole = whole._replace(variance=whole.variance + 3.0)
    for a, b in zip(whole, both, strict=True):
        assert a == pytest.approx(b, abs=1e-12)
