"""The ten features: order, values, chunks, batches, and what is refused."""

from __future__ import annotations

import math
import shutil

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from numpy.testing import assert_allclose

from ndtorch.vision import FEATURES, GROUPS, HassensteinReichardt, OrientedDoG, VisualFeatures
from ndtorch.vision.motion import BORDERS, Border
from tests.strategies import chunkings, in_chunks


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def moving_bar(direction: float, orientation: float, size: int = 120, steps: int = 60) -> torch.Tensor:
    """A soft white bar at 1 px a frame, `[T, 1, H, W]`; degrees counter-clockwise as seen."""
    towards, tilt = math.radians(direction), math.radians(orientation)
    rows, columns = np.mgrid[:size, :size] - (size - 1) / 2
    frames = []
    for t in range(steps):
        x = columns - (t - steps / 2) * math.cos(towards)
        y = -rows - (t - steps / 2) * math.sin(towards)
        along = -x * math.sin(tilt) + y * math.cos(tilt)
        across = x * math.cos(tilt) + y * math.sin(tilt)
        frames.append(np.clip(25.5 - abs(along), 0, 1) * np.clip(6.5 - abs(across), 0, 1))
    return torch.from_numpy(np.stack(frames)[:, None].astype(np.float32))


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


@pytest.mark.parametrize(("direction", "name"), [(0, "right"), (90, "up"), (180, "left"), (270, "down")])
def test_a_bar_drives_the_direction_it_moves_in(direction: float, name: str) -> None:
    out, _ = VisualFeatures((120, 120))(moving_bar(direction, direction))
    assert FEATURES[out[-1, GROUPS["motion"]].argmax()] == name


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize(("orientation", "name"), [(0, "0°"), (60, "60°"), (120, "120°"), (-60, "120°")])
def test_a_bar_drives_its_orientation(border: Border, orientation: float, name: str) -> None:
    out, _ = VisualFeatures((120, 120), border=border)(moving_bar(0, orientation, steps=3))
    assert FEATURES[4 + out[-1, GROUPS["orientation"]].argmax()] == name


@pytest.mark.parametrize("border", BORDERS)
def test_a_static_scene_has_no_motion(border: Border) -> None:
    out, _ = VisualFeatures((12, 14), border=border)(noise(3, 12, 14).float().expand(30, 3, 12, 14))
    assert not out[:, :4].any()
    assert_allclose(out[:, 4:], out[:1, 4:].expand(30, 6), rtol=1e-6)


@settings(max_examples=15, deadline=None)
@given(lengths=chunkings(10))
def test_chunks_give_the_whole(lengths: list[int]) -> None:
    module, frames = VisualFeatures((16, 20)), noise(10, 3, 16, 20).float()
    whole, end = module(frames)
    parts, part_end = in_chunks(module, frames, lengths, -4, -2)
    assert_allclose(parts, whole, rtol=1e-5, atol=1e-5)
    assert_allclose(part_end.slow, end.slow, atol=1e-6)


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


@pytest.mark.compiled
@NEEDS_COMPILER
def test_compiled_sums_are_the_same() -> None:
    module = VisualFeatures((32, 32))
    compiled = torch.compile(module, dynamic=False)
    state = fast_state = None
    for frames in noise(6, 3, 32, 32).float().split(2):
        out, state = module(frames, state)
        fast, fast_state = compiled(frames, fast_state)
        assert_allclose(fast, out, rtol=1e-4, atol=1e-4)
