"""Ten signals over a grid of overlapping receptive fields."""

from __future__ import annotations

import pytest
import torch

from ndtorch.scenes import Bar, BarScene
from ndtorch.utils.backend import set_backend
from ndtorch.vision import LocalFeatures, VisualFeatures, field_weights
from ndtorch.vision.motion import Border


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


def test_a_bar_is_seen_where_it_is() -> None:
    local = LocalFeatures(VisualFeatures((320, 320)), 10)
    frames = BarScene([Bar((0.1, 0.9, 0.1), 0.0, (112.0, 240.0))], 0.5, size=(320, 320)).frames(0, 50)
    signals, _ = local(frames)
    seen = signals[-1].flatten(0, 1)
    assert divmod(int(seen[:, 1].argmax()), 10) == (7, 4)  # right, half a second later at column 137
    assert divmod(int(seen[:, 8].argmax()), 10) == (7, 4)  # green


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
