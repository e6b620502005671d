"""The statistics of an image are right, and blank, noisy and blurred images are told from good ones."""

import cv2
import numpy as np
import pytest
import torch

from ndtorch.navigation import Strips
from ndtorch_robot.camera_monitor.image_quality import change, check_image, measure, texture
from ndtorch_robot.camera_monitor.limits import CameraLimits

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


def blurred(wall, floor, light=1.0, grain=0.0, turns=9.0):
    """A picture out of focus: the brightness of its row, and of its subfield, in levels with noise of one.

    With `grain` its floor is not: levels by which blocks of four pixels differ.
    """
    random = np.random.default_rng(3)
    row = wall(np.linspace(-1, 1, 640)[None])
    field = 106 + floor * np.sin(np.linspace(0, turns, 85)) * np.cos(np.linspace(0, 3, 29))[:, None]
    field = field + grain * random.normal(0, 1, (8, 22)).repeat(4, 0).repeat(4, 1)[:29, :85]
    parts = [light * part + random.normal(0, 1, part.shape) for part in (field, row)]
    return measure(Strips(*(torch.from_numpy(np.round(part)).to(torch.uint8)[None, None] for part in parts)))


def test_a_smooth_row_over_a_floor_without_grain_is_blurred():
    """Too smooth to count as contrast, and the floor just shows something: told by neither alone."""

    def wall(x):
        return 190 + 35 * np.tanh(2 * x)

    seen = blurred(wall, 10, turns=5.0)
    assert seen.statistics.row_contrast < 0.05 * seen.statistics.row_mean
    assert 1.0 < seen.statistics.field_contrast / (0.012 * seen.statistics.field_mean) < 2.0
    assert seen.statistics.row_range > 60
    assert "is blurred" in str(check_image(seen, CameraLimits()))
    # The same wall over a floor that is seen well, or has grain, may be a wall in a lamp's light.
    assert check_image(blurred(wall, 60, turns=5.0), CameraLimits()) is None
    assert check_image(blurred(wall, 10, grain=2.0, turns=5.0), CameraLimits()) is None
    assert check_image(blurred(wall, 60, grain=6.0, turns=5.0), CameraLimits()) is None
    # And a wall with less shade than that is not judged.
    assert check_image(blurred(lambda x: 190 + 7 * np.tanh(2 * x), 10, turns=5.0), CameraLimits()) is None


def test_a_wall_of_few_shades_over_a_floor_without_any_grain_is_blurred():
    """Noise of one level has edges of a third of its range, and the floor shows some shadows."""

    def wall(x):
        return 170 + 11 * np.sin(4 * x)

    for floor, turns in ((12, 5.0), (16, 4.0)):
        seen = blurred(wall, floor, turns=turns)
        assert seen.statistics.row_max_step > 0.2 * seen.statistics.row_range > 3.2
        assert 1.5 < seen.statistics.field_contrast / (0.012 * seen.statistics.field_mean) < 3.2
        assert "is blurred" in str(check_image(seen, CameraLimits()))
    # What good cameras see right before a smooth wall, where the floor should be, bends a little more.
    assert 0.03 < texture(blurred(wall, 16, turns=5.0)) < 0.06
    assert check_image(blurred(wall, 16, turns=5.0), CameraLimits()) is None
    # The same wall is no fault over grain, over floor that is seen well, with an edge, or with fewer shades still.
    assert check_image(blurred(wall, 10, grain=1.0, turns=5.0), CameraLimits()) is None
    assert check_image(blurred(wall, 60, turns=5.0), CameraLimits()) is None
    assert check_image(blurred(lambda x: 170 + 11 * np.sign(np.sin(4 * x)), 10, turns=5.0), CameraLimits()) is None
    assert check_image(blurred(lambda x: 170 + 6 * np.sin(4 * x), 10, turns=5.0), CameraLimits()) is None


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
