"""The observation list."""

import math

import pytest

from ndtorch.navigation import ObservationList
from tests.navigation.mapping.test_grid_map import poses, ranges_of


def test_list_keeps_the_newest_and_forgets():
    module = ObservationList(dt=0.5, capacity=4, lifetime=2.0)
    state = None
    for t in range(3):
        seen, state = module(ranges_of([[[1.0 + t, 0.0], [1.0, 1.0]]]), poses([0.0, 0.0, 0.0]), state)
    assert seen.x.tolist() == [3.0, 1.0, 2.0, 1.0]
    wanted = [1.0, 1.0, math.exp(-0.25), math.exp(-0.25)]
    assert seen.weight.tolist() == pytest.approx(wanted)
    turned, _ = module(ranges_of([[[1.0, 0.0]]], [[False]]), poses([2.0, 3.0, math.pi / 2]))
    assert (turned.weight == 0).all()
    assert (float(turned.x[0]), float(turned.y[0])) == pytest.approx((2.0, 4.0))
    assert turned.seen_from[0].tolist() == pytest.approx([2.0, 3.0, math.pi / 2])
