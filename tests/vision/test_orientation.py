"""Oriented DoG filters against kernels sampled in space, and the quick sums against the exact ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose
from scipy.ndimage import gaussian_filter

from ndtorch.scenes import moving_bar
from ndtorch.vision import ANGLES, OrientedDoG
from ndtorch.vision.motion import BORDERS, Border
from tests.strategies import noise


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


def worst_error(size: tuple[int, int], border: Border, image: torch.Tensor) -> float:
    quick, exact = (OrientedDoG(size, border=border, exact=e).sums(image) for e in (False, True))
    return float((quick / exact - 1).abs().max())


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("degrees", [-30.0, 90.0])
@pytest.mark.parametrize(("size", "limit"), [((500, 500), 0.005), ((243, 331), 0.01)])
def test_quick_sums_of_moving_bars(size: tuple[int, int], limit: float, border: Border, degrees: float) -> None:
    scene = moving_bar(degrees, size=size, fps=10, seconds=0.8, start=(150.0, 110.0))
    assert worst_error(size, border, scene.frames(0, 8)[:, 0]) < limit


@pytest.mark.parametrize(
    ("size", "limit"), [((500, 500), 0.01), ((243, 331), 0.01), ((100, 100), 0.02), ((97, 64), 0.02)]
)
@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("sigma", [2.0, 12.0])
def test_quick_sums_of_natural_images(size: tuple[int, int], limit: float, border: Border, sigma: float) -> None:
    assert worst_error(size, border, natural(size, 5, sigma)) < limit


# Small filters, of which the second allows one halving of the image.
SMALL = [((4.0, 2.0), (5.0, 3.0)), ((5.0, 3.2), (6.0, 4.0))]


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize(("center", "surround"), SMALL)
def test_gradients(border: Border, exact: bool, center: tuple[float, float], surround: tuple[float, float]) -> None:
    module = OrientedDoG((10, 8), center=center, surround=surround, border=border, exact=exact)
    assert torch.autograd.gradcheck(module.sums, (noise(10, 8).requires_grad_(),))
