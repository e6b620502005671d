"""An odometry edge is the sum of its steps and knows its derivative by the errors of the odometer."""

import numpy as np
import pytest

from ndtorch.navigation.localisation.odometry_edge import compose, empty_edge, integrate

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
