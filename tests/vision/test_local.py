"""Ten signals over a grid of overlapping receptive fields."""

from __future__ import annotations

import math

import pytest
import torch

from ndtorch.scenes import Bar, BarScene
from ndtorch.utils.backend import set_backend
from ndtorch.vision import LocalFeatures, VisualFeatures, field_weights
from ndtorch.vision.motion import Border
from ndtorch.vision.receptive_fields import Edge, Shape, means


@pytest.mark.parametrize(("size", "border"), [((500, 500), "wrap"), ((90, 120), "wrap"), ((432, 600), "reflect")])
def test_the_fields_together_see_what_the_wide_field_sees(size: tuple[int, int], border: Border) -> None:
    frames = torch.nn.functional.avg_pool2d(torch.rand(5, 3, *size), 7, 1, 3)
    wide = VisualFeatures(size, border=border)
    local = LocalFeatures(wide, 9)
    expected, _ = wide(frames)
    signals, _ = local(frames)
    assert signals.shape == (5, *local.grid, 10)
    assert float(((signals.sum((1, 2)) - expected).abs() / expected.amax(0)).max()) < 1e-3


def test_every_field_agrees_with_the_feature_images() -> None:
    wide = VisualFeatures((400, 400))
    local = LocalFeatures(wide, 12)
    frames = BarScene([Bar((0.8, 0.2, 0.1), 30.0, (120.0, 210.0))], 0.1, size=(400, 400)).frames(0, 10)
    images, _ = wide.images(frames)
    signals, _ = local(frames)
    rows = field_weights(torch.arange(400) + 0.5, 400, 12)
    expected = torch.einsum("rh,fhw,cw->rcf", rows, images[-1], rows)
    error = (signals[-1] - expected).abs().amax((0, 1)) / expected.amax((0, 1)).clamp_min(1e-3)
    assert float(error.max()) < 0.03


@pytest.mark.parametrize("border", ["wrap", "reflect"])
@pytest.mark.parametrize(
    "kind",
    [
        torch.uint8,
        pytest.param(torch.float32, marks=pytest.mark.long),
        pytest.param(torch.float64, marks=pytest.mark.long),
    ],
)
def test_kernels_give_what_torch_gives(kind: torch.dtype, border: Border) -> None:
    local = LocalFeatures(VisualFeatures((400, 40), border=border), 5)
    frames = torch.randint(0, 256, (4, 3, 400, 40), dtype=torch.uint8)
    frames = frames if kind == torch.uint8 else frames.to(kind) / 255
    set_backend(local, "torch")
    wanted, end = local(frames)
    set_backend(local, "numba")
    beside = frames[:1].permute(0, 2, 3, 1).contiguous().permute(0, 3, 1, 2)
    first, state = local(beside)
    rest, last = local(frames[1:], state)
    found = torch.cat([first, rest])
    assert found.dtype == wanted.dtype
    scale = wanted.flatten(0, 2).amax(0)
    error = ((found - wanted).abs() / scale).amax()
    assert float(error) < (1e-6 if kind == torch.float64 else 2e-5)
    for part, other in zip(last, end, strict=True):
        torch.testing.assert_close(part, other, rtol=0, atol=1e-6)


def tents(length: int, fields: int) -> torch.Tensor:
    return means(field_weights(torch.arange(length) + 0.5, length, fields, "open", "tent"))


@pytest.mark.parametrize("shape", ["cosine", "tent"])
@pytest.mark.parametrize("border", ["wrap", "reflect"])
@pytest.mark.parametrize(("length", "fields"), [(500, 16), (120, 7), (33, 5), (40, 1)])
def test_windows_add_up_to_one_everywhere(shape: Shape, border: Edge, length: int, fields: int) -> None:
    weights = field_weights(torch.arange(length, dtype=torch.float64) + 0.5, length, fields, border, shape)
    assert weights.shape == (fields, length)
    assert float((weights.sum(0) - 1).abs().max()) < 1e-12
    assert float(weights.min()) >= 0


def test_a_window_is_a_raised_cosine() -> None:
    weights = field_weights(torch.tensor([15.0, 20.0, 22.5, 25.0, 35.0]), 100, 10)
    half = 0.5 + 0.5 * math.cos(math.pi * 0.75)
    assert weights[1].tolist() == pytest.approx([1.0, 0.5, half, 0.0, 0.0], abs=1e-6)


def test_a_window_is_a_tent() -> None:
    weights = field_weights(torch.tensor([1.0, 5.0, 20.0, 22.5, 25.0]), 100, 10, "open", "tent")
    assert weights[0].tolist() == pytest.approx([0.6, 1.0, 0.0, 0.0, 0.0], abs=1e-6)
    assert weights[1].tolist() == pytest.approx([0.0, 0.0, 0.5, 0.25, 0.0], abs=1e-6)


def test_fields_are_means_and_overlap_by_half() -> None:
    weights = tents(12, 3)
    assert torch.allclose(weights.sum(1), torch.ones(3))
    # Where the first falls off, the second rises: both see the pixels between their centers.
    assert ((weights[0] > 0) & (weights[1] > 0)).sum() == 4
    assert weights[1].argmax() in (5, 6)
    assert torch.equal(tents(5, 1), torch.full((1, 5), 0.2))
