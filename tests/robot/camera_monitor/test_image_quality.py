"""Statistics of images, and the direction of their flow."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
import torch

from ndtorch.navigation import Strips
from ndtorch_robot.camera_monitor.image_quality import ImageStatistics, Snapshot, change, check_image, measure
from ndtorch_robot.camera_monitor.limits import CameraLimits
from ndtorch_robot.camera_monitor.motion_check import FlowDirectionCheck, shifted_correlation

LIMITS = CameraLimits()


def strips(dtype=torch.uint8, width=640, size=(29, 85), seed=0):
    """Things of five pixels; parts of a larger picture, as they come from a camera."""
    rng = np.random.default_rng(seed)
    things = rng.integers(20, 250, (1, 3, size[0] + 8, width // 5 + 10)).astype(np.uint8).repeat(5, -1)
    whole = torch.from_numpy(things)
    whole = whole if dtype == torch.uint8 else whole.to(dtype) / 255
    return Strips(whole[..., : size[0], 30 : 30 + size[1]], whole[..., 5:6, :width])


@pytest.mark.parametrize("dtype", [torch.uint8, torch.float32, torch.float64])
@pytest.mark.parametrize(("width", "size"), [(640, (29, 85)), (63, (12, 20)), (21, (4, 21))])
def test_block_means_by_their_definition(dtype, width, size):
    picture = strips(dtype, width, size)
    scale = 1 if dtype == torch.uint8 else 255
    field = scale * picture.field[0, 1].double().numpy()[: size[0] // 4 * 4, : size[1] // 4 * 4]
    row = scale * picture.row[0, 1, 0].double().numpy()[: width // 4 * 4]
    seen = measure(picture)
    field = field.reshape(size[0] // 4, 4, -1, 4).mean((1, 3))
    np.testing.assert_allclose(seen.field, field, rtol=1e-5)
    np.testing.assert_allclose(seen.row, row.reshape(-1, 4).mean(1), rtol=1e-5)
    lag = min(8, (len(seen.row) - 1) // 4)
    shading = (seen.row[: -2 * lag] + seen.row[2 * lag :]) / 2
    np.testing.assert_allclose(seen.row_detail, seen.row[lag:-lag] - shading, atol=1e-3)
    assert seen.statistics.row_contrast == pytest.approx(seen.row_detail.std(), rel=1e-4)
    assert seen.statistics.field_contrast == pytest.approx(seen.field_detail.std(), rel=1e-4)


def test_change_leaves_out_a_common_change_of_light():
    now, before = measure(strips(seed=0)), measure(strips(seed=1))
    assert change(now.row, before.row) == pytest.approx((now.row - before.row).std(), rel=1e-5)
    assert change(now.field + 10, now.field) == pytest.approx(0.0, abs=1e-4)
    assert change(now.field[:0], now.field[:0]) == 0.0


def test_statistics():
    """Against what can be worked out by hand: two levels of gray, with one edge."""
    whole = torch.full((1, 3, 16, 64), 40, dtype=torch.uint8)
    whole[..., 32:] = 120
    whole[:, 1, :, :4] = 0
    seen = measure(Strips(whole[..., :8, :32], whole[..., 8:9, :])).statistics
    assert seen.row_mean == pytest.approx((28 * 40 + 32 * 120) / 64)
    assert seen.field_mean == pytest.approx(28 * 40 / 32)
    assert seen.row_max_step == 80
    assert seen.row_step_power == pytest.approx((40**2 + 80**2) / 63)
    assert seen.row_range == 120
    assert seen.row_sd == pytest.approx(np.asarray(whole[0, 1, 0], float).std())


@pytest.mark.parametrize("size", [(9, 9), (3, 3), (0, 0)])
def test_tiny_subfields_are_no_error(size):
    seen = measure(strips(size=size))
    assert seen.field.shape == (size[0] // 4, size[1] // 4)
    assert check_image(seen, CameraLimits()) is None


def test_nothing_is_not_believed_to_be_something():
    picture = strips(torch.float32)
    assert check_image(measure(picture), CameraLimits()) is None
    gray = Strips(*(part * 0.001 + 0.5 for part in picture))
    assert "shows nothing" in str(check_image(measure(gray), CameraLimits()))
    noise = torch.rand(1, 3, 1, 640, generator=torch.Generator().manual_seed(1))
    assert "shows noise" in str(check_image(measure(picture._replace(row=noise)), CameraLimits()))
    soft = 0.5 + 0.4 * torch.sin(torch.arange(640.0) / 40).expand(1, 3, 1, 640)
    assert "is blurred" in str(check_image(measure(picture._replace(row=soft)), CameraLimits()))


@pytest.mark.parametrize("shades", [10, 17])
def test_a_border_down_the_subfield_is_not_that_of_a_blurred_picture(shades):
    """A smooth wall fills the row and hides the floor, but where it ends below is sharp."""
    random = np.random.default_rng(5)
    row = 142 + shades * np.tanh(2 * np.linspace(-1, 1, 640))[None]
    lines, columns = np.mgrid[:70, :560]
    wall = np.where(lines < 34 + columns / 100, 145.0, 48.0)

    def seen(field, shade=0.0):
        field = field + shade * np.sin(columns / 30)
        parts = [np.round(part + random.normal(0, 1, part.shape)) for part in (field, row)]
        return check_image(
            measure(Strips(*(torch.from_numpy(part).to(torch.uint8)[None, None] for part in parts))), LIMITS
        )

    assert seen(wall) is None
    assert seen(wall, 17.0) is None
    for blur in (8, 14):
        soft = cv2.GaussianBlur(wall, (0, 0), blur)
        assert "is blurred" in str(seen(soft, 17.0))


@pytest.mark.parametrize("steps", [4, 6, 9])
def test_a_staircase_of_sharp_steps_is_not_blurred(steps):
    """Each step, as of the facets of a pillar, is a small part of the range of the row."""
    random = np.random.default_rng(6)
    row = (100 + 16 * (np.arange(640) * steps // 640) + np.arange(640) / 40.0)[None]
    floor = 90 + 12 * np.sin(np.arange(560) / 30) * np.ones((70, 1))

    def seen(row):
        parts = [np.round(part + random.normal(0, 1, part.shape)) for part in (floor, row)]
        return check_image(
            measure(Strips(*(torch.from_numpy(part).to(torch.uint8)[None, None] for part in parts))), LIMITS
        )

    assert seen(row) is None
    assert "is blurred" in str(seen(cv2.GaussianBlur(row, (0, 0), 14)))


@pytest.mark.parametrize("noise", [1.0, 2.0])
def test_a_blurred_row_in_the_dark_is_told_from_its_noise(noise):
    random = np.random.default_rng(4)

    def told(row, floor):
        parts = (27 + floor * random.choice([-1.0, 1.0], (29, 85)).repeat(4, 1)[:, :85], row[None])
        parts = [np.clip(part + random.normal(0, noise, part.shape), 0, 255).round() for part in parts]
        return check_image(
            measure(Strips(*(torch.from_numpy(p).to(torch.uint8)[None, None] for p in parts))), CameraLimits()
        )

    soft = 45 + 14 * np.sin(np.arange(640) / 30)
    sharp = 45 + 14 * np.sign(np.sin(np.arange(640) / 30))
    assert [told(soft, 0.0) is not None for _ in range(10)] == [True] * 10
    assert "is blurred" in str(told(soft, 0.0))
    assert [told(sharp, 0.0) for _ in range(10)] == [None] * 10
    assert [told(sharp, 8.0) for _ in range(10)] == [None] * 10


FOCAL, BLOCKS = 430.0, 160


def seen(heading, seed=1, noise=0.5, mirrored=False):
    """What a camera sees of a round wall, block by block, that looks to there, radians to the left."""
    random = np.random.default_rng(seed)
    wall = np.repeat(random.uniform(30, 220, 200), 5)
    columns = (np.arange(BLOCKS) - (BLOCKS - 1) / 2) * 4
    angles = np.arctan2(columns, FOCAL) - heading
    row = np.interp(angles * FOCAL / 4 + 500, np.arange(1000), wall)
    row = (row + np.random.default_rng(round(1e6 + 1e4 * heading)).normal(0, noise, BLOCKS)).astype(np.float32)
    row = row[::-1].copy() if mirrored else row
    return Snapshot(row, row[None], row, row[None], ImageStatistics(*[0.0] * 8))


def said_after(turn, mirrored, flat=False, most=12):
    """How many pieces of a turn it takes until it is said; None where it never is."""
    turning = FlowDirectionCheck(FOCAL, CameraLimits())
    eyes = [seen(n * turn, mirrored=mirrored) for n in range(most + 1)]
    if flat:
        eyes = [eye._replace(row=0 * eye.row + 99) for eye in eyes]
    for n, (before, now) in enumerate(pairwise(eyes), 1):
        if turning.compare(now, before, turn):
            return n
    return None


@pytest.mark.parametrize("turn", [0.08, -0.08, 0.25, -0.25])
def test_a_camera_upside_down_is_told_after_some_pieces_of_a_turn(turn):
    assert said_after(turn, mirrored=True) == 4
    assert said_after(turn, mirrored=False) is None


def test_who_sees_nothing_says_nothing():
    assert said_after(0.1, mirrored=True, flat=True) is None


@pytest.mark.parametrize("shift", [8.0, -8.0])
def test_a_row_fits_where_it_was_moved_to(shift):
    row = np.random.default_rng(1).uniform(30, 220, BLOCKS)
    moved = np.roll(row, round(shift * 1.3))
    assert shifted_correlation(moved, row, shift) > 0.95
    assert shifted_correlation(moved, row, -shift) < 0.5
    assert shifted_correlation(moved, row, shift / 2) < 0.5
