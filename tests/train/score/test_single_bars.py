"""The table of single bars."""

from __future__ import annotations

import pytest
from numpy.testing import assert_allclose

from ndtorch_train.score.single_bars import measure, single_bars


@pytest.mark.slow
@pytest.mark.parametrize(("direction", "orientation"), [(0, 0), (3, 6)])
def test_the_table_of_single_bars_is_measured(direction: int, orientation: int) -> None:
    assert_allclose(single_bars()[direction, orientation], measure(direction, orientation), rtol=2e-3, atol=0.5)
