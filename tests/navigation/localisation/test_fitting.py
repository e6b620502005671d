"""Two parts of a bare wall are fitted to each other: only as far off as they may be wrong."""

import numpy as np
import pytest
import torch

from ndtorch.navigation.localisation import LocaliserParams
from ndtorch.navigation.localisation.fitting import fit_pair, likely
from ndtorch.navigation.localisation.parts import Parts, add_to_part, finish, is_ripe, no_parts
from ndtorch.navigation.localisation.walls import Fit, Scan
from ndtorch.navigation.localisation.way import no_way

pytest.importorskip("numba")

HERE, DT = (0.0, 0.0, 0.0), 1 / 30
NOTHING = (np.zeros(3), np.full(3, 1e-3))


def wall(count: int, left: float = 0.0) -> Scan:
    """So many cells of a wall, which have eight points each."""
    x = left + np.arange(8 * count) / 32 + 0.01
    return Scan(x, 0.4 + 0 * x, np.ones(len(x)))


def made(scan: Scan, params: LocaliserParams, parts: Parts | None = None) -> Parts:
    return add_to_part(parts or no_parts(HERE, params), scan, HERE, params)


def two(unsure: float) -> Parts:
    """Two parts of the same wall, with a corner at its end, drawn 0.2 m apart."""
    params, corner = LocaliserParams(), np.linspace(0.4, 1.4, 32)
    scans = [
        Scan(*(np.r_[a, b] for a, b in zip(wall(12), (0 * corner + 3 + off, corner, 1 + 0 * corner), strict=True)))
        for off in (0.0, 0.2)
    ]
    parts = finish(made(scans[0], params), HERE, torch.tensor(60.0), DT, *NOTHING, params)
    way = no_way()._replace(unsure=torch.tensor([unsure**2, 1e-6], dtype=torch.float64))
    parts = made(scans[1], params, parts._replace(came=way))
    return finish(parts, HERE, torch.tensor(120.0), DT, *NOTHING, params)


def test_a_fit_is_searched_for_no_farther_than_the_graph_may_be_wrong():
    sure, unsure = (fit_pair(two(deviation), LocaliserParams()) for deviation in (0.001, 0.2))
    assert not len(sure.pairs)
    assert not len(sure.edges) or abs(float(sure.edges[0, 2])) < 0.05
    assert unsure.edges[0, :2].tolist() == [0, 1]
    assert float(unsure.edges[0, 2]) == pytest.approx(-0.2, abs=0.03)


@pytest.mark.parametrize(("deviation", "believed"), [(0.02, False), (0.2, True)])
def test_a_fit_far_from_where_it_is_expected_is_believed_only_if_little_is_known(deviation, believed):
    fit = Fit(0.3, 0.0, 0.0, 0.9, np.array((1e5, 0.0, 1e5, 0.0, 0.0, 1e5)))
    assert likely(fit, np.zeros(3), np.diag([deviation**2] * 3), LocaliserParams().parts) == believed


def test_a_part_that_shows_little_is_made_longer():
    params = LocaliserParams()
    p = params.parts

    def after(count, length):
        parts = made(wall(count), params)
        return parts._replace(driven=parts.driven._replace(length=torch.tensor(length, dtype=torch.float64)))

    lengths = [p.way - 0.1, p.way + 0.1, p.longest - 0.1, p.longest + 0.1]
    assert [is_ripe(after(p.ripe - 1, length), params) for length in lengths] == [False, False, False, True]
    assert [is_ripe(after(p.ripe, length), params) for length in lengths] == [False, True, True, True]


def test_a_part_of_few_cells_is_fitted_before_those_that_share_more_but_less_of_theirs():
    params = LocaliserParams()
    parts = no_parts(HERE, params)
    for n, scan in enumerate((wall(6), wall(20, 1.0), wall(14))):
        parts = finish(made(scan, params, parts), HERE, torch.tensor(60.0 * (n + 1)), DT, *NOTHING, params)
    assert [pair[:2] for pair in parts.pairs.tolist() if pair[1] == 2] == [[0, 2], [1, 2]]
