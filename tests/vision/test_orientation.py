"""Oriented DoG filters against kernels sampled in space, and the quick sums against the exact ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter

from ndtorch.errors import InputError
from ndtorch.scenes import moving_bar
from ndtorch.vision import ANGLES, OrientedDoG, dog_spectrum
from ndtorch.vision._kernels_orientation import mirrored
from ndtorch.vision.decimation import (
    halvings,
    inside_weights,
    low_rows,
    mirrored_start,
    smooth_length,
    smooth_margin,
    thin_rows,
    thinning_gain,
)
from ndtorch.vision.motion import BORDERS, Border


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def kernel(size: int, degrees: float) -> np.ndarray:
    """Kernel of [B eq. 14-16] around pixel (0, 0) of a torus, summed over its copies; rows point down."""
    angle = math.radians(degrees)
    copies = np.arange(-4, 5) * size
    y = (np.arange(size)[:, None] + copies).reshape(size, 1, -1, 1)
    x = (np.arange(size)[:, None] + copies).reshape(1, size, 1, -1)
    # Unit vectors as seen (x right, y up): the long axis is vertical, turned counter-clockwise.
    along = x * -math.sin(angle) + -y * math.cos(angle)
    across = x * math.cos(angle) + -y * math.sin(angle)
    total = np.zeros((size, size))
    for sign, (a, b) in ((1, (19, 6)), (-1, (22, 9))):
        gauss = np.exp(-0.5 * (along / a) ** 2 - 0.5 * (across / b) ** 2) / (2 * math.pi * a * b)
        total += sign * gauss.sum((-1, -2))
    return total


def bar(size: int, degrees: float, length: float = 50, width: float = 12) -> torch.Tensor:
    """White bar in the middle, its long axis `degrees` counter-clockwise from vertical, `[H, W]`."""
    angle = math.radians(degrees)
    rows, columns = np.mgrid[:size, :size] - (size - 1) / 2
    along = -columns * math.sin(angle) - rows * math.cos(angle)
    across = columns * math.cos(angle) - rows * math.sin(angle)
    return torch.from_numpy(((abs(along) <= length / 2) & (abs(across) <= width / 2)).astype(np.float32))


def natural(size: tuple[int, int], seed: int, sigma: float) -> torch.Tensor:
    """Blurred noise over a gradient of light, 0..1: edges that do not fit together."""
    image = gaussian_filter(np.random.default_rng(seed).random(size), sigma, mode="reflect")
    image = (image - image.min()) / np.ptp(image) + np.linspace(0, 0.8, size[1])
    return torch.from_numpy((image / image.max()).astype(np.float32))


@pytest.mark.parametrize("index", [0, 1, 2])
def test_responses_are_a_circular_convolution_with_the_kernel(index: int) -> None:
    image = noise(60, 60)
    weights = kernel(60, ANGLES[index])
    expected = np.zeros((60, 60))
    for dy, dx in np.ndindex(60, 60):
        expected += weights[dy, dx] * np.roll(image.numpy(), (dy, dx), (0, 1))
    got = OrientedDoG((60, 60)).images(image)[index]
    assert_allclose(got, expected, atol=1e-6 * abs(expected).max())


def test_spectrum_is_the_transform_of_the_kernel() -> None:
    rows = torch.fft.fftfreq(48, dtype=torch.float64)[:, None]
    columns = torch.fft.fftfreq(48, dtype=torch.float64)
    for degrees in (0.0, 60.0, 120.0, -17.0):
        got = dog_spectrum(rows, columns, math.radians(degrees))
        assert_allclose(got, np.fft.fft2(kernel(48, degrees)).real, atol=1e-12)


def test_kernels_sum_to_zero() -> None:
    assert dog_spectrum(torch.zeros(1), torch.zeros(1), 0.3).item() == 0


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("exact", [True, False])
def test_a_uniform_image_gives_nothing(border: Border, exact: bool) -> None:
    module = OrientedDoG((90, 80), border=border, exact=exact)
    assert module.sums(torch.full((90, 80), 0.7)).max() < 1e-5 * 90 * 80


def test_mirrored_border_at_zero_degrees_is_two_separable_blurs() -> None:
    image = natural((150, 130), 3, 4)
    got = OrientedDoG((150, 130), border="reflect").images(image)[0].numpy()
    blur = [gaussian_filter(image.numpy(), sigma, mode="mirror", truncate=6) for sigma in ((19, 6), (22, 9))]
    # Beyond three sigma the library's kernel wraps around.
    assert_allclose(got, blur[0] - blur[1], atol=0.01 * abs(blur[0] - blur[1]).max())


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize(("degrees", "index"), [(0, 0), (60, 1), (120, 2), (180, 0), (-60, 2), (-120, 1)])
def test_a_bar_drives_its_own_orientation(exact: bool, degrees: float, index: int) -> None:
    sums = OrientedDoG((100, 100), exact=exact).sums(bar(100, degrees))
    assert sums.argmax() == index
    others = [k for k in range(3) if k != index]
    assert sums[index] > 1.2 * sums[others].max()


def test_a_bar_between_two_orientations_drives_both_alike() -> None:
    sums = OrientedDoG((120, 120), exact=True).sums(bar(120, -30))
    assert sums[0] == pytest.approx(float(sums[2]), rel=0.02)
    assert sums[1] < sums[0]


@pytest.mark.parametrize("border", BORDERS)
def test_exact_sums_are_the_sums_of_the_images(border: Border) -> None:
    module, image = OrientedDoG((70, 81), border=border, exact=True), noise(2, 70, 81)
    assert_allclose(module.sums(image), module.images(image).abs().sum((-1, -2)), rtol=1e-12)


def worst_error(size: tuple[int, int], border: Border, image: torch.Tensor) -> float:
    quick, exact = (OrientedDoG(size, border=border, exact=e).sums(image) for e in (False, True))
    return float((quick / exact - 1).abs().max())


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("degrees", [-30.0, 13.0, 90.0, 180.0])
@pytest.mark.parametrize(("size", "limit"), [((500, 500), 0.005), ((243, 331), 0.01)])
def test_quick_sums_of_moving_bars(size: tuple[int, int], limit: float, border: Border, degrees: float) -> None:
    scene = moving_bar(degrees, size=size, fps=10, seconds=0.8, start=(150.0, 110.0))
    assert worst_error(size, border, scene.frames(0, 8)[:, 0]) < limit


@pytest.mark.parametrize("size", [(500, 500), (243, 331)])
@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("sigma", [1.0, 4.0, 12.0])
def test_quick_sums_of_natural_images(size: tuple[int, int], border: Border, sigma: float) -> None:
    assert worst_error(size, border, natural(size, 5, sigma)) < 0.01


@pytest.mark.parametrize("size", [(60, 60), (100, 100), (97, 64)])
@pytest.mark.parametrize("border", BORDERS)
def test_quick_sums_of_small_images(size: tuple[int, int], border: Border) -> None:
    assert worst_error(size, border, natural(size, 2, 2.0)) < 0.02


@pytest.mark.parametrize("exact", [True, False])
def test_float32_is_near_float64(exact: bool) -> None:
    module, image = OrientedDoG((100, 90), exact=exact), noise(100, 90)
    assert_allclose(module.sums(image.float()), module.sums(image), rtol=1e-4)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("batch", [(), (4,), (2, 3)])
def test_shapes(border: Border, exact: bool, batch: tuple[int, ...]) -> None:
    module = OrientedDoG((40, 50), border=border, exact=exact)
    assert module.sums(torch.rand(*batch, 40, 50)).shape == (*batch, 3)
    assert module.images(torch.rand(*batch, 40, 50)).shape == (*batch, 3, 40, 50)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("exact", [True, False])
def test_batch_equals_single_images(border: Border, exact: bool) -> None:
    module, images = OrientedDoG((60, 50), border=border, exact=exact), noise(2, 2, 60, 50)
    assert_allclose(module.sums(images)[1, 0], module.sums(images[1, 0]), rtol=1e-12)


def test_frames_give_signed_responses_to_their_grey() -> None:
    module, frames = OrientedDoG((30, 40)), noise(2, 3, 30, 40)
    assert_allclose(module(frames), module.images(frames.mean(-3)), atol=1e-15)
    assert module(frames).min() < 0 < module(frames).max()


@pytest.mark.parametrize("count", [1, 4])
def test_any_number_of_angles(count: int) -> None:
    module = OrientedDoG((64, 64), angles=tuple(range(0, 45 * count, 45)))
    assert module.sums(torch.rand(64, 64)).shape == (count,)


# Small filters, of which the second allows one halving of the image.
SMALL = [((4.0, 2.0), (5.0, 3.0)), ((5.0, 3.2), (6.0, 4.0))]


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize(("center", "surround"), SMALL)
def test_gradients(border: Border, exact: bool, center: tuple[float, float], surround: tuple[float, float]) -> None:
    module = OrientedDoG((10, 8), center=center, surround=surround, border=border, exact=exact)
    assert torch.autograd.gradcheck(module.sums, (noise(10, 8).requires_grad_(),))


@pytest.mark.parametrize("border", BORDERS)
def test_coarse_grids_begin_where_the_margin_does(border: Border) -> None:
    """Pixel n of the frame is at n + 1/2, so the first pixel of the margin is at 1/2 less the margin."""
    module = OrientedDoG((96, 120), border=border)
    for grid, padded, size in zip(module.places(), module.padded, module.size, strict=True):
        cell = padded / grid.shape[1]
        margin = (padded - size) / 2
        assert (margin == 0) == (border == "wrap")
        assert_allclose(grid.diff(dim=1), cell, rtol=1e-5)
        assert_allclose(grid[:, 0], [0.5 - margin, 0.5 - margin + cell / 2], rtol=1e-5)


def test_unknown_border_is_refused() -> None:
    with pytest.raises(InputError, match=r"border must be one of wrap, reflect, got 'zero'"):
        OrientedDoG((20, 20), border="zero")  # type: ignore[arg-type]


@pytest.mark.parametrize("sigma", [0.0, -3.0])
def test_sigmas_must_be_positive(sigma: float) -> None:
    with pytest.raises(InputError, match="positive standard deviations"):
        OrientedDoG((20, 20), center=(19.0, sigma))


def test_frames_of_another_size_are_refused() -> None:
    with pytest.raises(InputError, match="must be 20x30 pixels"):
        OrientedDoG((20, 30))(torch.zeros(1, 3, 30, 20))


def test_thinned_rows_are_triangles_around_the_middles_of_blocks() -> None:
    image = noise(3, 8, 6)
    assert torch.equal(thin_rows(image, 1), image)
    for block in (2, 4, 8):
        middles = torch.arange(0, 8, block) + (block - 1) / 2
        away = (torch.remainder(torch.arange(8) - middles[:, None] + 4, 8) - 4).abs()
        # On a torus as short as two blocks a row lies on both sides of a middle.
        far = 8 - away
        weights = ((1 - away / block).clamp_min(0) + (1 - far / block).clamp_min(0)).double()
        torch.testing.assert_close(thin_rows(image, block), weights @ image, atol=1e-14, rtol=0)


def test_thinned_rows_of_a_mirror_image_are_mirrored() -> None:
    image = noise(3, 24, 6)
    torch.testing.assert_close(thin_rows(image.flip(-2), 4), thin_rows(image, 4).flip(-2), atol=1e-15, rtol=0)


@pytest.mark.parametrize("cell", [1.0, 0.97, 1.5, 2.0, 5.556])
def test_samples_of_a_mirror_image_are_the_same(cell: float) -> None:
    start = mirrored_start(cell)
    shift = (-1 - 2 * start) / cell
    assert shift == pytest.approx(round(shift), abs=1e-9)
    assert abs(start) <= cell / 4 + 1e-9


@pytest.mark.parametrize(("length", "rows"), [(12, 5), (12, 6), (9, 4), (7, 7)])
def test_low_rows_are_those_of_a_band_limited_wave(length: int, rows: int) -> None:
    n = torch.arange(length, dtype=torch.float64)
    wave = torch.cos(2 * math.pi * n / length + 0.3)
    low = low_rows(torch.fft.fft(wave)[:, None], rows)[:, 0]
    coarse = torch.arange(rows, dtype=torch.float64) * length / rows
    expected = torch.cos(2 * math.pi * coarse / length + 0.3)
    assert_allclose(torch.fft.ifft(low).real.numpy() * rows / length, expected.numpy(), atol=1e-12)


@pytest.mark.parametrize("block", [1, 2, 4])
def test_thinning_gain_is_what_a_sinusoid_loses(block: int) -> None:
    n = torch.arange(64, dtype=torch.float64)
    middle = (block - 1) / 2
    for cycles in (1, 4, 9):
        wave = torch.cos(2 * math.pi * cycles * (n - middle) / 64)[:, None]
        kept = thin_rows(wave, block)[0, 0] / block
        gain = thinning_gain(torch.tensor(cycles / 64, dtype=torch.float64), block)
        assert kept.item() == pytest.approx(gain.item(), abs=1e-12)


@pytest.mark.parametrize(
    ("length", "spacing", "times"), [(500, 4.0, 2), (500, 3.9, 1), (500, 100, 2), (501, 4, 0), (64, 8, 3)]
)
def test_halvings(length: int, spacing: float, times: int) -> None:
    assert halvings(length, spacing) == times


def test_smooth_length_is_the_next_quick_length() -> None:
    quick = [n for n in range(1, 1200) if 30**20 % n == 0]
    for n in range(1, 1000):
        assert smooth_length(n) == min(q for q in quick if q >= n)


def test_margins_make_quick_lengths() -> None:
    for length in range(2, 400):
        margin = smooth_margin(length, 66)
        quick = [m for m in range(min(66, length - 1), length) if 30**20 % (length + 2 * m) == 0]
        assert margin == (quick[0] if quick else min(66, length - 1))
    assert smooth_margin(500, 0) == 0


@pytest.mark.parametrize(("length", "points", "margin"), [(120, 32, 10), (90, 90, 20), (61, 16, 3)])
@pytest.mark.parametrize("offset", [0.0, 0.5])
def test_inside_weights_cover_the_image_once(length: int, points: int, margin: int, offset: float) -> None:
    weights = inside_weights(length, points, margin, offset)
    assert weights.sum().item() * length / points == pytest.approx(length - 2 * margin)
    assert ((weights >= 0) & (weights <= 1)).all()


def test_mirrored_margins_are_those_of_torch() -> None:
    images = torch.rand(2, 7, 11, generator=torch.Generator().manual_seed(5))
    padded = np.empty((2, 7 + 2 * 6, 11 + 2 * 4), np.float32)
    mirrored(images.numpy(), 6, 4, padded)
    assert np.array_equal(padded, F.pad(images, (4, 4, 6, 6), mode="reflect").numpy())
