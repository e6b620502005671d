"""Searching the right row: right where there is something to tell apart, silent where there is not."""

import pytest
import torch

from ndtorch.navigation import StereoRanging, StereoRig
from ndtorch.navigation.stereo.search import SearchParams, search_rows

RIG = StereoRig()


def texture(width=900, seed=5):
    noise = torch.rand(1, 1, width, generator=torch.Generator().manual_seed(seed))
    return torch.nn.functional.avg_pool1d(noise, 3, 1, 1)[0, 0]


def shifts(found):
    return (found.left - found.right)[found.valid]


@pytest.mark.parametrize("disparity", [25, 90, 200])
def test_it_finds_how_far_a_textured_row_has_shifted(disparity):
    row = texture()
    pair = torch.stack((row[:640], row[disparity : disparity + 640]))
    found = search_rows(pair, SearchParams())
    assert found.valid.all()
    assert ((shifts(found) - disparity).abs() < 0.3).all()


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
    ranges, _ = StereoRanging(RIG, 1 / 30, search=SearchParams())(left, right)
    assert ranges.valid[-1].any()
    depth = ranges.x[-1][ranges.valid[-1]]
    torch.testing.assert_close(depth, torch.full_like(depth, RIG.focal * RIG.baseline / 100), rtol=5e-3, atol=0)


def test_cameras_may_differ_in_exposure_and_walls_may_slant():
    row = texture()
    bright = torch.stack((row[:640] * 0.8, row[90:730] * 0.88))
    found = search_rows(bright, SearchParams())
    assert found.valid.all()
    assert ((shifts(found) - 90).abs() < 0.3).all()
    dim = 0.3 + 0.05 * bright  # hardly any texture: most of what there is to compare is the level
    dim[1] *= 1.1
    assert ((shifts(search_rows(dim, SearchParams(min_step_ratio=0))) - 90).abs() < 0.3).all()
    unleveled = shifts(search_rows(dim, SearchParams(min_step_ratio=0, mean_half_width_px=0)))
    assert not ((unleveled - 90).abs() < 0.3).all() or len(unleveled) == 0
    row = torch.nn.functional.avg_pool1d(row[None, None], 5, 1, 2)[0, 0]
    place = torch.arange(640.0) * 1.2 + 60  # what each pixel of the right row shows: disparities grow with the column
    low = place.long().clamp(max=898)
    slanted = torch.stack((row[:640], torch.lerp(row[low], row[low + 1], (place - low).clamp(max=1))))
    found = search_rows(slanted, SearchParams(min_step_ratio=0))
    assert found.valid.all()
    assert ((found.right - (found.left - 60) / 1.2).abs() < 1).all()


def test_lone_matches_among_others_are_not_believed():
    """A strip of the left row that the right row shows elsewhere, narrower than what must agree."""
    row, other = texture(), texture(seed=6)
    left, right = row[:640].clone(), row[50:690].clone()
    left[300:312] = other[:12]
    right[180:192] = other[:12]
    pair = torch.stack((left, right))
    loose = search_rows(pair, SearchParams(count=200, half_width_px=3, agreement_ratio=0.0, uniqueness_ratio=0.9))
    strict = search_rows(pair, SearchParams(count=200, half_width_px=3, agreement_ratio=1.0, uniqueness_ratio=0.9))
    wrong = [int(((shifts(found) - 50).abs() > 1).sum()) for found in (loose, strict)]
    assert wrong[0] > wrong[1]
    assert int(strict.valid.sum()) > 50


# Every kind is compiled, for seconds; frames of cameras are of whole numbers.
@pytest.mark.parametrize(
    "kind", [torch.uint8, *(pytest.param(kind, marks=pytest.mark.long) for kind in (torch.float32, torch.float64))]
)
def test_kernels_and_torch_find_the_same(kind):
    pytest.importorskip("numba")
    rows = torch.stack([texture(seed=seed) for seed in (1, 2, 3)])
    frames = (torch.stack((rows[:, :640], rows[:, 70:710] * 1.02)) * 250).round()
    frames = frames.to(kind) if kind == torch.uint8 else frames.to(kind) / 255
    module = StereoRanging(RIG, 1 / 30, search=SearchParams(ahead_count=4))
    left, right = frames[0][None, None], frames[1][None, None]
    wanted, state = module(left, right)
    with torch.inference_mode():
        found, also = module(left, right)
    assert bool(wanted.valid.any())
    assert (wanted.valid == found.valid).double().mean() > 0.9
    alike = wanted.valid & found.valid & ((wanted.left_angle - found.left_angle).abs() < 1e-5)
    assert alike.sum() >= 0.9 * wanted.valid.sum()
    torch.testing.assert_close(found.left_range[alike], wanted.left_range[alike], rtol=1e-4, atol=0)
    torch.testing.assert_close(also.rows.low, state.rows.low, rtol=0, atol=1e-6)
