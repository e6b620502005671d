"""A way is the sum of its steps, and knows what another odometer would have made of it."""

import numpy as np
import pytest

from ndtorch.navigation.localisation.way import drive_on, no_way, one_way

DT = 0.2
STEPS = [(0.1, 0.0, 0.02), (0.12, 0.3, 0.0), (0.08, -0.2, -0.05)] * 4


def way(steps, odometer):
    found = no_way()
    for step in steps:
        found = drive_on(found, step, DT, odometer)
    return found


def test_a_way_knows_how_it_changes_with_the_errors_of_the_odometer():
    known, size = np.array((0.02, -0.01, 0.003)), 1e-5
    found = way(STEPS, tuple(known))
    for n in range(3):
        change = np.zeros(3)
        change[n] = size
        ends = [way(STEPS, tuple(known + s * change)).pose.numpy() for s in (1, -1)]
        assert found.change.numpy()[:, n] == pytest.approx((ends[0] - ends[1]) / (2 * size), rel=1e-4, abs=1e-6)


def test_two_ways_are_one():
    known = (0.02, -0.01, 0.003)
    first, second = (way(steps, known) for steps in (STEPS[:5], STEPS[5:]))
    first, second = (part._replace(unsure=part.unsure + n) for part, n in ((first, 1.0), (second, 2.0)))
    whole, both = way(STEPS, known), one_way(first, second)
    whole = whole._replace(unsure=whole.unsure + 3.0)
    for a, b in zip(whole, both, strict=True):
        assert a.numpy() == pytest.approx(b.numpy(), abs=1e-12)
