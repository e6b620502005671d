"""The ten features: order, values, chunks, batches, and what is refused."""

from __future__ import annotations

import shutil

import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.vision import FEATURES, GROUPS, HassensteinReichardt, OrientedDoG, VisualFeatures
from ndtorch.vision.motion import BORDERS, Border
from tests.strategies import in_chunks, noise


def test_names_and_groups() -> None:
    assert FEATURES == ("left", "right", "down", "up", "0°", "60°", "120°", "red", "green", "blue")
    assert [FEATURES[group] for group in GROUPS.values()] == [FEATURES[:4], FEATURES[4:7], FEATURES[7:]]
    assert list(GROUPS) == ["motion", "orientation", "color"]


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
