"""Searching the right row: right where there is something to tell apart, silent where there is not."""

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import RowRanging, StereoRig
from ndtorch.navigation.row_search import SearchParams, search_rows

RIG = StereoRig()


def texture(width=900, seed=5):
    noise = torch.rand(1, 1, width, generator=torch.Generator().manual_seed(seed))
    return torch.nn.functional.avg_pool1d(noise, 3, 1, 1)[0, 0]


@pytest.mark.parametrize("disparity", [25, 90, 200])
def test_it_finds_how_far_a_textured_row_has_shifted(disparity):
    row = texture()
    pair = torch.stack((row[:640], row[disparity : disparity + 640]))
    found = search_rows(pair, SearchParams())
    assert int(found.valid.sum()) >= 30
    shift = (found.left - found.right)[found.valid]
    assert ((shift - disparity).abs() < 0.3).all()


def test_blank_rows_and_repeated_posts_give_nothing():
    blank = torch.full((2, 640), 0.5)
    assert not search_rows(blank, SearchParams()).valid.any()
    posts = ((torch.arange(640 + 40) % 40) < 8).float() * 0.4 + 0.3
    found = search_rows(torch.stack((posts[:640], posts[10:650])), SearchParams())
    # Near the left border there are too few other posts to compare with.
    assert not (found.valid & (found.left > 100)).any()


def test_batches_and_single_rows_agree_and_a_standing_car_is_given_ranges():
    rows = torch.stack((texture()[:640], texture()[100:740]))
    both = search_rows(torch.stack((rows, rows.flip(0))), SearchParams())
    torch.testing.assert_close(both.right[0], search_rows(rows, SearchParams()).right)
    left, right = (row.expand(4, 1, 1, 640) for row in rows)
    ranges, _ = RowRanging(RIG, 1 / 30, search=SearchParams())(left, right)
    assert ranges.valid[-1].any()
    depth = ranges.x[-1][ranges.valid[-1]]
    torch.testing.assert_close(depth, torch.full_like(depth, RIG.focal * RIG.baseline / 100), rtol=5e-3, atol=0)


def test_numbers_out_of_range_are_refused():
    for values in ({"count": 0}, {"ratio": 1.5}, {"min_disparity": 200, "max_disparity": 100}):
        with pytest.raises(InputError):
            SearchParams(**values)
