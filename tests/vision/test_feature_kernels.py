"""The ten sums by kernels are those of the step functions in torch."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.utils.backend import set_backend
from ndtorch.vision import VisualFeatures
from ndtorch.vision.motion import BORDERS, Border, MotionState

pytest.importorskip("numba")

# Long enough for two grids to be thinned out and rows to be halved, and narrow enough to be quick.
SIZE = (400, 40)
# Every kind is compiled, for seconds; double precision is the rarest.
KINDS = (torch.uint8, torch.float32, pytest.param(torch.float64, marks=pytest.mark.long))


def noise(dtype: torch.dtype, frames: int = 4, size: tuple[int, int] = SIZE) -> Tensor:
    pixels = torch.randint(0, 256, (frames, 3, *size), dtype=torch.uint8)
    return pixels if dtype == torch.uint8 else pixels.to(dtype) / 255


def same(found: Tensor, wanted: Tensor) -> None:
    # Sums of magnitudes cancel in the difference of two directions: errors are measured by the largest of them.
    scale = float(wanted[:, :4].max())
    tolerance = 1e-6 if found.dtype == torch.float64 else 2e-5
    torch.testing.assert_close(found[:, :4], wanted[:, :4], rtol=0, atol=tolerance * scale)
    torch.testing.assert_close(found[:, 4:], wanted[:, 4:], rtol=tolerance, atol=0)


def by_torch(module: VisualFeatures, frames: Tensor, state: MotionState | None = None) -> tuple[Tensor, MotionState]:
    set_backend(module, "torch")
    out: tuple[Tensor, MotionState] = module(frames, state)
    set_backend(module, "auto")
    return out


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_sums_and_state(kind: torch.dtype, exact: bool, border: Border) -> None:
    module, frames = VisualFeatures(SIZE, border=border, exact=exact), noise(kind)
    wanted, end = by_torch(module, frames)
    first, state = module(frames[:1])
    before = [part.clone() for part in state]
    rest, last = module(frames[1:], state)
    whole, _ = module(frames)
    assert first[0, :4].tolist() == [0, 0, 0, 0]
    same(torch.cat([first, rest]), wanted)
    assert torch.equal(whole, torch.cat([first, rest]))
    for part, then in zip(state, before, strict=True):
        assert torch.equal(part, then)  # a state that is given is never written
    for part, other in zip(last, end, strict=True):
        torch.testing.assert_close(part, other, rtol=0, atol=1e-6)


def test_colors_beside_each_other_in_memory() -> None:
    module, frames = VisualFeatures(SIZE), noise(torch.uint8)
    beside = frames.permute(0, 2, 3, 1).contiguous().permute(0, 3, 1, 2)
    torch.testing.assert_close(module(beside)[0], module(frames)[0], rtol=1e-6, atol=1e-3)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize(("widest", "halvings"), [(3.0, 1), (12.0, 3)])
def test_any_number_of_halvings(border: Border, widest: float, halvings: int) -> None:
    across, around = (2 * widest, widest), (2.5 * widest, 1.5 * widest)
    module = VisualFeatures((400, 96), border=border, center=across, surround=around)
    assert module.orientation.blocks[0] == 2**halvings
    frames = noise(torch.float32, 9, (400, 96))
    wanted, _ = by_torch(module, frames)
    whole, _ = module(frames)
    found, state = [], None
    for frame in frames:
        out, state = module(frame[None], state)
        found.append(out)
    same(whole, wanted)
    # A transform of several pictures may round otherwise than one of each: on aarch64 it does, by 1.1e-7.
    torch.testing.assert_close(whole, torch.cat(found), rtol=1e-6, atol=0)


def test_floats_that_are_not_scaled_are_refused() -> None:
    frames = noise(torch.float32, 5)
    frames[4, 1, 36, 7] = 3.0  # one pixel, in a row that is looked at: every twelfth
    with pytest.raises(InputError, match=r"must lie in 0..1, got .* to 3"):
        by_torch(VisualFeatures(SIZE), frames)
    with pytest.raises(InputError, match=r"must lie in 0..1, got .* to 3"):
        VisualFeatures(SIZE)(frames)
