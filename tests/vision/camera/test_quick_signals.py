"""The kernels of a camera's fields against the steps in torch."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from ndtorch.vision.camera.front_end import CameraFrontEnd
from ndtorch.vision.camera.params import CameraParams
from ndtorch.vision.camera.quick_signals import quick_signals

SIZE = (48, 64)


@pytest.mark.parametrize(
    "options",
    [{}, {"scale": 0, "compression": False}, {"scale": 2, "color_inhibition": False, "grid": (1, 1)}],
    ids=["as it is", "finest, not compressed", "coarsest, one field"],
)
def test_the_kernels_do_what_the_steps_do(options: dict[str, Any]) -> None:
    """Pictures whose parts move by up to several pixels a step, so that the level is not always the same."""
    pytest.importorskip("numba")
    generator = torch.Generator().manual_seed(3)
    front = CameraFrontEnd(SIZE, 30.0, CameraParams(**options))
    ground, speck = torch.rand(3, *SIZE, generator=generator), torch.rand(3, 12, 12, generator=generator) - 0.5
    scales, levels = None, set()
    for step in range(10):
        seen = torch.zeros(3, *SIZE)
        at = 20 if step < 5 else 4 * step
        seen[:, 10:22, at : at + 12] = speck
        shown = (seen.abs().amax(0, keepdim=True) * 3).clamp(0, 1)
        images = (ground + seen, ground, seen, shown)
        wanted, after = front._signals(*images, scales)
        if scales is not None:
            filters = (front.dt, front.a_high, front.a_low)
            with torch.inference_mode():
                quick = quick_signals(images, scales, filters, front._weights(), front.orientation, front.parts)
            assert quick is not None
            row, state = quick
            levels.add(int(wanted[3]))
            # Signals are roots: of what is nothing but for rounding, that is some ten thousandths.
            for one, found, error in zip(wanted, row, (1e-3, 1e-6, 1e-5, 0, 1e-3), strict=True):
                assert one.shape == found.shape
                assert one.dtype == found.dtype
                torch.testing.assert_close(found, one, rtol=1e-4, atol=error)
            torch.testing.assert_close(tuple(state), tuple(after), rtol=1e-4, atol=1e-5)
        scales = after
    assert wanted[0].max() > 0.1
    assert len(levels) > (1 if front.parts.scale == "auto" else 0)


def test_torch_does_what_kernels_do_not() -> None:
    """Without a background, in double precision, and where gradients are wanted."""
    front = CameraFrontEnd(SIZE, 30.0)
    images = (*(torch.rand(3, *SIZE) for _ in range(3)), torch.rand(1, *SIZE))
    _, scales = front._signals(*images, None)
    rest = (scales, (front.dt, front.a_high, front.a_low), front._weights(), front.orientation)
    assert quick_signals(images, *rest, front.parts) is None
    with torch.inference_mode():
        assert quick_signals(images, *rest, CameraParams(background=False)) is None
        doubles = tuple(part.double() for part in images)
        assert quick_signals(doubles, *rest, front.parts) is None
