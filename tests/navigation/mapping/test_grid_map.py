"""The grid map, the log-odds map, large grids in tiles, and the observation list."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.errors import InputError
from ndtorch.navigation import Grid, GridMap, ObservationList, Pose, Ranges, StereoRig
from ndtorch.navigation.mapping.certainty import certainty
from ndtorch.navigation.mapping.tiles import SIDE, add_at, cell_tables, check_tiles, empty_tiles
from tests.navigation.planar_world import to_body

RIG = StereoRig()
GRID = Grid(-1.0, 5.0, -3.0, 3.0)


def ranges_of(points, valid=None, rig=RIG):
    """Ranges of points of the body frame, `[..., T, n, 2]`."""
    points = torch.as_tensor(points, dtype=torch.float32)
    x, y = points.unbind(-1)
    left, right = torch.atan2(y - rig.baseline / 2, x), torch.atan2(y + rig.baseline / 2, x)
    valid = torch.ones(x.shape, dtype=torch.bool) if valid is None else torch.as_tensor(valid)
    return Ranges(torch.hypot(x, y - rig.baseline / 2), left, right, x, y, valid)


def poses(*values):
    return Pose(*torch.tensor(values, dtype=torch.float32).unbind(-1))


def random_run(seed, *batch, steps=6, count=3):
    generator = torch.Generator().manual_seed(seed)
    points = torch.rand(*batch, steps, count, 2, generator=generator) * torch.tensor([1.4, 1.6])
    points = points + torch.tensor([0.7, -0.8])
    pose = torch.rand(*batch, steps, 3, generator=generator) * torch.tensor([1.5, 1.0, 0.6])
    valid = torch.rand(*batch, steps, count, generator=generator) < 0.7
    return ranges_of(points, valid), Pose(*pose.unbind(-1))


def test_cells_against_fine_sampling_of_the_formula():
    """Mean of the printed certainty over every cell, from 5x5 points each, at a turned and shifted pose."""
    grid, fine = Grid(0.0, 3.0, -0.5, 2.5), 5
    ranges, pose = ranges_of([[[1.6, 0.3], [1.1, -0.2]]]), poses([0.4, 0.2, 0.5])
    cells, _ = GridMap(RIG, grid)(ranges, pose)
    place = (torch.arange(300 * fine, dtype=torch.float64) + 0.5) / (100 * fine)
    wanted = torch.zeros(300 * fine, 300 * fine, dtype=torch.float64)
    x, y = to_body(pose, place.unsqueeze(0), (place - 0.5).unsqueeze(1))
    for k in range(2):
        wanted += certainty(x, y, Ranges(*(part[0, k] for part in ranges)), RIG)
    wanted = wanted.reshape(300, fine, 300, fine).mean((1, 3))
    assert float(cells.sum()) == pytest.approx(float(wanted.sum()), rel=0.01)
    assert float((cells - wanted).square().mean().sqrt()) < 0.08 * float(wanted.square().mean().sqrt())
    for k in range(2):
        # The center of each blob lies where the feature is seen.
        part, _ = GridMap(RIG, grid)(ranges._replace(valid=torch.tensor([[k == 0, k == 1]])), pose)
        row, column = divmod(int(part.argmax()), 300)
        x, y = to_body(pose, *grid.center(torch.tensor(row), torch.tensor(column)))
        assert float(x) == pytest.approx(float(ranges.x[0, k]), abs=0.03)
        assert float(y) == pytest.approx(float(ranges.y[0, k]), abs=0.02)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_the_map_is_never_negative_and_only_grows(seed):
    ranges, pose = random_run(seed)
    mapper = GridMap(RIG, GRID)
    first, state = mapper(ranges, pose)
    first = first.clone()
    second, _ = mapper(ranges, pose, state)
    assert (first >= 0).all()
    torch.testing.assert_close(second, 2 * first)
    normal = mapper.normalise(second)
    assert float(normal.max()) == (1.0 if ranges.valid.any() else 0.0)


@pytest.mark.parametrize("certainty", ["beams", "log-odds"])
def test_an_old_state_stays_as_it_was(certainty):
    """Whoever keeps a state can go on from it, as often as wanted; nothing is changed behind anybody's back."""
    mapper = GridMap(RIG, GRID, certainty=certainty)
    first, later = random_run(3, 2), random_run(4, 2)
    _, kept = mapper(*first)
    before = kept.cells.clone()
    one, after = mapper(*later, kept)
    other, _ = mapper(*later, kept)
    assert torch.equal(kept.cells, before)
    assert torch.equal(one, other)
    assert not torch.equal(after.cells, before)
    # Tiles that were not touched are shared.
    tiles = [pair for rows in zip(kept.tiles.rows, after.tiles.rows, strict=True) for pair in zip(*rows, strict=True)]
    assert any(a is b for a, b in tiles)
    assert all(a is b or a.untyped_storage().data_ptr() != b.untyped_storage().data_ptr() for a, b in tiles)


def test_two_views_sharpen_the_map():
    """The same point seen from two directions is more certain than either view alone."""
    point = torch.tensor([1.5, 0.5])
    here, there = poses([0.0, 0.0, 0.0]), poses([1.2, -0.9, math.pi / 2])
    mapper = GridMap(RIG, GRID)
    single, state = mapper(ranges_of(torch.stack(to_body(here, *point), -1).unsqueeze(0)), here)
    single = single.clone()
    both, _ = mapper(ranges_of(torch.stack(to_body(there, *point), -1).unsqueeze(0)), there, state)
    row, column = divmod(int(both.argmax()), GRID.columns)
    x, y = GRID.center(torch.tensor(row), torch.tensor(column))
    assert math.hypot(float(x) - 1.5, float(y) - 0.5) < 0.02
    assert both.max() > 1.5 * single.max()


def test_log_odds():
    mapper = GridMap(RIG, GRID, certainty="log-odds")
    look = ranges_of([[[1.5, 0.0]]]), poses([0.0, 0.0, 0.0])
    state = None
    for _ in range(10):
        cells, state = mapper(*look, state)
    probability = cells.sigmoid()
    at = lambda x, y: float(probability[round((y + 3) * 100), round((x + 1) * 100)])  # noqa: E731
    assert at(1.5, 0.0) > 0.6  # the feature
    assert at(0.8, 0.0) < 0.4  # the line of sight
    assert at(2.5, 0.0) == 0.5  # behind it nothing is known
    assert at(0.8, 0.5) == 0.5
    for _ in range(200):
        state = mapper.update(*look, state)
    assert float(state.cells.abs().max()) == mapper.odds.limit
    # It changes its mind: something is now seen through the place.
    further = ranges_of([[[2.1, 0.0]]]), look[1]
    for _ in range(200):
        cells, state = mapper(*further, state)
    probability = cells.sigmoid()
    assert at(1.5, 0.0) < 0.4


def test_tiles_hold_what_was_added_where() -> None:
    """Against a plain tensor, for several maps at once."""
    generator = torch.Generator().manual_seed(2)
    rows, columns = 150, 200
    down, across = cell_tables(rows, columns)
    tiles, plain = empty_tiles((2, 3), rows, columns, torch.zeros(1)), torch.zeros(2, 3, rows, columns)
    for _ in range(5):
        row = torch.randint(0, rows, (2, 3, 40), generator=generator)
        column = torch.randint(0, columns, (2, 3, 40), generator=generator)
        weight = torch.randn(2, 3, 40, generator=generator)
        tiles = add_at(tiles, down[row] + across[column], weight, limit=1.0)
        plain.flatten(-2).scatter_add_(-1, row * columns + column, weight)
        plain.clamp_(-1.0, 1.0)
    torch.testing.assert_close(tiles.cells[..., :rows, :columns], plain)


def test_a_step_shares_what_it_does_not_touch_and_leaves_the_grid_it_was_given() -> None:
    old = empty_tiles((), 2 * SIDE, 3 * SIDE, torch.zeros(1))
    down, across = cell_tables(2 * SIDE, 3 * SIDE)
    new = add_at(old, (down[SIDE + 1] + across[2 * SIDE + 5]).view(1), torch.ones(1))
    assert new.cells.nonzero().tolist() == [[SIDE + 1, 2 * SIDE + 5]]
    assert not old.cells.any()
    assert sum(a is not b for a, b in zip(sum(old.rows, ()), sum(new.rows, ()), strict=True)) == 1


@pytest.mark.parametrize(
    ("batch", "rows", "columns"), [((), 130, 200), ((3,), 130, 200), ((2,), 65, 200), ((2,), 130, 64), ((2,), 200, 130)]
)
def test_tiles_of_another_batch_or_size_are_refused(batch: tuple[int, ...], rows: int, columns: int) -> None:
    tiles = empty_tiles((2,), 130, 200, torch.zeros(1))
    check_tiles("state", tiles, (2,), 129, 193)  # rounded up to whole tiles it is the same
    with pytest.raises(InputError, match=r"state .* do not fit"):
        check_tiles("state", tiles, batch, rows, columns)


def test_tiles_hold_floating_point_numbers() -> None:
    for kind in (torch.int64, torch.float16):
        with pytest.raises(InputError, match="state must be float"):
            check_tiles("state", empty_tiles((), SIDE, SIDE, torch.zeros(1, dtype=kind)), (), SIDE, SIDE)
    with pytest.raises(InputError, match="state must be a Tiles"):
        check_tiles("state", torch.zeros(SIDE, SIDE), (), SIDE, SIDE)  # type: ignore[arg-type]


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
