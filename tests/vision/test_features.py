"""The ten features: order, values, chunks, batches, and what is refused."""

from __future__ import annotations

import shutil

import pytest
import torch
from numpy.testing import assert_allclose
from torch import Tensor

from ndtorch.arguments import set_backend
from ndtorch.errors import InputError
from ndtorch.vision import HassensteinReichardt, OrientedDoG, VisualFeatures
from ndtorch.vision.frames import check_frames
from ndtorch.vision.motion import BORDERS, Border, MotionState
from tests.benchmarks.bench_features import on_device
from tests.strategies import in_chunks, noise


@pytest.mark.parametrize("border", BORDERS)
def test_sums_are_those_of_motion_orientation_and_color(border: Border) -> None:
    frames = noise(4, 3, 20, 24)
    out, _ = VisualFeatures((20, 24), 0.02, 0.4, 0.03, border, exact=True)(frames)
    motion, _ = HassensteinReichardt(0.02, 0.4, 0.03, border)(frames)
    orientation = OrientedDoG((20, 24), border=border)(frames).abs()
    expected = torch.cat([motion, orientation, frames], -3).sum((-1, -2))
    assert_allclose(out, expected, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("border", BORDERS)
def test_images_sum_to_the_sums(border: Border) -> None:
    module, frames = VisualFeatures((20, 24), border=border, exact=True), noise(4, 3, 20, 24)
    images, end = module.images(frames)
    out, state = module(frames)
    assert images.shape == (4, 10, 20, 24)
    assert images.min() >= 0
    assert_allclose(images.sum((-1, -2)), out, rtol=1e-10, atol=1e-12)
    assert_allclose(end.slow, state.slow, rtol=1e-12, atol=1e-14)
    assert_allclose(end.delayed, state.delayed, rtol=1e-12, atol=1e-14)


def test_frames_larger_than_the_cache_are_cut_into_blocks() -> None:
    module, frames = VisualFeatures((300, 400)), noise(5, 3, 300, 400).float()
    whole, _ = module(frames)
    one_by_one, _ = in_chunks(module, frames, 1, -4, -2)
    assert_allclose(whole, one_by_one, rtol=1e-5)


@pytest.mark.parametrize("exact", [True, False])
def test_gradients(exact: bool) -> None:
    module, frames = VisualFeatures((6, 5), 0.05, exact=exact), noise(3, 3, 6, 5).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: module(v)[0], (frames,))


NEEDS_COMPILER = pytest.mark.skipif(
    shutil.which("gcc") is None and shutil.which("g++") is None, reason="needs a C++ compiler"
)


@pytest.mark.parametrize(
    "backend", ["aot_eager", pytest.param("inductor", marks=[pytest.mark.compiled, pytest.mark.long, NEEDS_COMPILER])]
)
def test_compiled_sums_are_the_same(backend: str) -> None:
    module = VisualFeatures((32, 32))
    compiled = torch.compile(module, dynamic=False, backend=backend)
    state = fast_state = None
    for frames in noise(6, 3, 32, 32).float().split(2):
        out, state = module(frames, state)
        fast, fast_state = compiled(frames, fast_state)
        assert_allclose(fast, out, rtol=1e-4, atol=1e-4)


# Long enough for two grids to be thinned out and rows to be halved, and narrow enough to be quick.
SIZE = (400, 40)
# Every kind is compiled, for seconds; double precision is the rarest.
KINDS = (torch.uint8, torch.float32, pytest.param(torch.float64, marks=pytest.mark.long))


def noise_frames(dtype: torch.dtype, frames: int = 4, size: tuple[int, int] = SIZE) -> Tensor:
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
    module, frames = VisualFeatures(SIZE, border=border, exact=exact), noise_frames(kind)
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
    module, frames = VisualFeatures(SIZE), noise_frames(torch.uint8)
    beside = frames.permute(0, 2, 3, 1).contiguous().permute(0, 3, 1, 2)
    torch.testing.assert_close(module(beside)[0], module(frames)[0], rtol=1e-6, atol=1e-3)


@pytest.mark.parametrize(("low", "high"), [(0.0, 255.0), (-1.0, 1.0), (0.0, 1.5), (-0.1, 1.0), (0.0, 1.1)])
def test_floats_out_of_range_are_refused(low: float, high: float) -> None:
    frames = torch.linspace(low, high, 2 * 3 * 500 * 4).reshape(2, 3, 500, 4)
    with pytest.raises(InputError, match=f"frames of floats must lie in 0..1, got {low:g} to .*divide by 255"):
        check_frames(frames)
    # A little too much is the interpolation's.
    check_frames(frames.clamp(-0.005, 1.005))


def test_the_benchmark_of_a_device_runs_on_a_cpu() -> None:
    assert float(on_device("cpu", count=2, size=40).figure.split()[0]) > 0
