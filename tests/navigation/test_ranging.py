"""Triangulation and the certainty of it."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.autograd import gradcheck

from ndtorch.navigation import Ranges, StereoRanging, StereoRig
from ndtorch.navigation.mapping.certainty import beam, beam_table, certainty, sample_certainty
from ndtorch.navigation.stereo.features import Matches
from ndtorch.navigation.stereo.ranging import triangulate
from ndtorch.navigation.stereo.search import SearchParams, search_rows


def matches(left, right, valid=None):
    left, right = (torch.tensor(side, dtype=torch.float64) for side in (left, right))
    valid = torch.ones(left.shape, dtype=torch.bool) if valid is None else torch.tensor(valid)
    return Matches(left, right, torch.zeros(left.shape, dtype=torch.float64), valid)


def test_ranges_of_known_points():
    """Points are projected into both rows by hand and found again."""
    rig = StereoRig(forward=0.1)
    for x, y in [(1.0, 0.0), (1.7, 0.4), (0.8, -0.3)]:
        left, right = (319.5 - 430 * (y - side) / (x - 0.1) for side in (0.15, -0.15))
        found = triangulate(matches([left], [right]), rig)
        assert float(found.x) == pytest.approx(x, rel=1e-9)
        assert float(found.y) == pytest.approx(y, abs=1e-9)
        assert float(found.left_range) == pytest.approx(math.hypot(x - 0.1, y - 0.15), rel=1e-9)
        assert float(found.left_angle) == pytest.approx(math.atan2(y - 0.15, x - 0.1), abs=1e-9)


def test_range_window():
    """[A]: 0.65-2.15 m straight ahead, 2.37 m with the linear angles."""
    rig, pairs = StereoRig(), matches([349.5, 419.5], [289.5, 219.5])  # disparity 60 and 200
    assert triangulate(pairs, rig).x.tolist() == pytest.approx([2.15, 0.645], abs=1e-9)
    assert float(triangulate(pairs, rig, "linear").x[0]) == pytest.approx(2.37, abs=0.01)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 638), st.integers(1, 638)), min_size=1, max_size=5), st.booleans())
def test_no_range_is_negative_or_infinite(pairs, linear):
    left, right = (list(side) for side in zip(*pairs, strict=True))
    found = triangulate(matches(left, right), StereoRig(), "linear" if linear else "atan")
    assert all(torch.isfinite(part).all() for part in found)
    assert (found.left_range[found.valid] > 0).all()
    assert found.valid.tolist() == [a > b for a, b in pairs]
    assert (found.left_range[~found.valid] == 0).all()


def test_beam_by_the_printed_formula():
    """[A eq. A.12] in polar coordinates."""
    for r, phi, theta in [(1.0, 0.1, 0.1), (2.0, 0.3, 0.302), (0.5, -0.4, -0.399)]:
        wanted = math.exp(-r * math.cos(theta - phi) / 3)
        wanted *= math.exp(-(math.tan(theta - phi) ** 2) / (2 * math.tan(0.002) ** 2))
        values = (r * math.cos(phi), r * math.sin(phi), theta)
        x, y, angle = (torch.tensor(v, dtype=torch.float64) for v in values)
        assert float(beam(x, y, angle, 0.002)) == pytest.approx(wanted, rel=1e-9)


def one_range(x, y, rig):
    left, right = (math.atan2(y - side, x) for side in (0.15, -0.15))
    values = (math.hypot(x, y - 0.15), left, right, x, y)
    return Ranges(*(torch.tensor([v], dtype=torch.float64) for v in values), torch.tensor([True]))


def test_gradients():
    rig = StereoRig()
    place = torch.tensor([1.5, 0.301], dtype=torch.float64, requires_grad=True)
    ranges = one_range(1.5, 0.3, rig)
    assert gradcheck(lambda p: certainty(p[0], p[1], ranges, rig), (place,))
    table = [part.double() for part in beam_table(rig, 2.2, 0.1)]

    def weights(angle):
        return sample_certainty(ranges._replace(left_angle=angle), rig, *table)

    assert gradcheck(weights, (ranges.left_angle.clone().requires_grad_(),))


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
    row = torch.nn.functional.avg_pool1d(row[None, None], 5, 1, 2)[0, 0]
    place = torch.arange(640.0) * 1.2 + 60  # what each pixel of the right row shows: disparities grow with the column
    low = place.long().clamp(max=898)
    slanted = torch.stack((row[:640], torch.lerp(row[low], row[low + 1], (place - low).clamp(max=1))))
    found = search_rows(slanted, SearchParams(min_step_ratio=0))
    assert found.valid.all()
    assert ((found.right - (found.left - 60) / 1.2).abs() < 1).all()
