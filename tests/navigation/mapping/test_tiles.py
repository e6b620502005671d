"""Large grids in tiles."""

from __future__ import annotations

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation.mapping.tiles import SIDE, add_at, cell_tables, check_tiles, empty_tiles


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
