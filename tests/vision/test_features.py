"""The ten features: order, values, chunks, batches, and what is refused."""

from __future__ import annotations

import math
import shutil

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from numpy.testing import assert_allclose

from ndtorch.errors import InputError
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
    assert torch.equal(end.slow, state.slow)
    assert torch.equal(end.delayed, state.delayed)


def test_images_of_one_frame_after_the_fact() -> None:
    module, frames = VisualFeatures((20, 24)), noise(2, 6, 3, 20, 24)
    _, state = module(frames)
    assert_allclose(module.images_at(frames[:, -1], state), module.images(frames)[0][:, -1], atol=1e-14)


@pytest.mark.parametrize(("direction", "name"), [(0, "right"), (90, "up"), (180, "left"), (270, "down")])
def test_a_bar_drives_the_direction_it_moves_in(direction: float, name: str) -> None:
    out, _ = VisualFeatures((120, 120))(moving_bar(direction, direction))
    assert FEATURES[out[-1, GROUPS["motion"]].argmax()] == name


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize(("orientation", "name"), [(0, "0°"), (60, "60°"), (120, "120°"), (-60, "120°")])
def test_a_bar_drives_its_orientation(border: Border, orientation: float, name: str) -> None:
    out, _ = VisualFeatures((120, 120), border=border)(moving_bar(0, orientation, steps=3))
    assert FEATURES[4 + out[-1, GROUPS["orientation"]].argmax()] == name


def test_each_color_is_the_sum_of_its_plane() -> None:
    frames = torch.zeros(1, 3, 10, 10)
    frames[0, 0, :3], frames[0, 1, :2], frames[0, 2, 0] = 0.5, 1.0, 0.25
    out, _ = VisualFeatures((10, 10))(frames)
    assert_allclose(out[0, 7:], [15, 20, 2.5])


@pytest.mark.parametrize("border", BORDERS)
def test_a_static_scene_has_no_motion(border: Border) -> None:
    out, _ = VisualFeatures((12, 14), border=border)(noise(3, 12, 14).float().expand(30, 3, 12, 14))
    assert not out[:, :4].any()
    assert_allclose(out[:, 4:], out[:1, 4:].expand(30, 6), rtol=1e-6)


def test_uint8_equals_its_share_of_255() -> None:
    frames = torch.randint(0, 256, (5, 3, 16, 16), dtype=torch.uint8)
    module = VisualFeatures((16, 16))
    assert_allclose(module(frames)[0], module(frames / 255)[0], rtol=1e-5, atol=1e-5)
    assert_allclose(module.images(frames)[0], module.images(frames / 255)[0], atol=1e-6)


def test_one_channel_equals_three_alike() -> None:
    module, frames = VisualFeatures((16, 16)), noise(2, 5, 1, 16, 16)
    assert torch.equal(module(frames)[0], module(frames.expand(2, 5, 3, 16, 16))[0])


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64, torch.uint8])
@pytest.mark.parametrize("batch", [(), (2,), (2, 3)])
def test_shapes(batch: tuple[int, ...], dtype: torch.dtype) -> None:
    scale = 255 if dtype == torch.uint8 else 1
    out, state = VisualFeatures((8, 9))((noise(*batch, 5, 3, 8, 9) * scale).to(dtype))
    assert out.shape == (*batch, 5, 10)
    assert state.slow.shape == state.delayed.shape == (*batch, 8, 9)
    assert out.dtype == (torch.float32 if dtype == torch.uint8 else dtype)


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


@pytest.mark.parametrize("size", [(16, 18), (400, 400)])
def test_batch_equals_single_runs(size: tuple[int, int]) -> None:
    module, frames = VisualFeatures(size), noise(2, 2, 3, 3, *size).float()
    first, state = module(frames[..., :2, :, :, :])
    last, state = module(frames[..., 2:, :, :, :], state)
    out = torch.cat([first, last], -2)
    assert state.slow.shape == (2, 2, *size)
    for i, j in np.ndindex(2, 2):
        alone, end = module(frames[i, j])
        assert_allclose(out[i, j], alone, rtol=1e-5, atol=1e-5)
        assert_allclose(state.delayed[i, j], end.delayed, atol=1e-6)


def test_one_state_starts_every_trial_of_large_frames() -> None:
    module, frames = VisualFeatures((400, 400)), noise(2, 1, 3, 400, 400).float()
    _, state = module(noise(2, 3, 400, 400, seed=1).float())
    together, _ = module(frames, state)
    assert_allclose(together[1], module(frames[1], state)[0], rtol=1e-5)


def test_float32_is_near_float64() -> None:
    module, frames = VisualFeatures((32, 32)), noise(20, 3, 32, 32)
    assert_allclose(module(frames.float())[0], module(frames)[0], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("exact", [True, False])
def test_gradients(exact: bool) -> None:
    module, frames = VisualFeatures((6, 5), 0.05, exact=exact), noise(3, 3, 6, 5).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: module(v)[0], (frames,))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("where", [(0, 0, 0, 0), (3, 2, 15, 15), (4, 1, 7, 3)])
def test_one_bad_pixel_is_found(value: float, where: tuple[int, int, int, int]) -> None:
    frames = noise(5, 3, 16, 16).float()
    frames[where] = value
    with pytest.raises(InputError, match="frames must be finite"):
        VisualFeatures((16, 16))(frames)


@pytest.mark.parametrize("size", [(1, 10), (10, 0), (10,), (10, 10, 3)])
def test_bad_sizes_are_refused(size: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="size must be a height and a width"):
        VisualFeatures(size)  # type: ignore[arg-type]


def test_bad_options_are_refused() -> None:
    with pytest.raises(InputError, match="border must be one of"):
        VisualFeatures((10, 10), border="black")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="dt must"):
        VisualFeatures((10, 10), dt=-0.01)
    with pytest.raises(InputError, match="tau"):
        VisualFeatures((10, 10), tau_low=-1)


@pytest.mark.parametrize("shape", [(3, 10, 12), (1, 3, 12, 10), (1, 4, 10, 12), (0, 3, 10, 12)])
def test_frames_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    module = VisualFeatures((10, 12))
    with pytest.raises(InputError, match="frames must"):
        module(torch.zeros(shape))
    with pytest.raises(InputError, match="frames must"):
        module.images(torch.zeros(shape))


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


def test_an_option_that_is_gone_says_what_took_its_place() -> None:
    with pytest.raises(InputError, match="fused is gone: the sums are always compiled"):
        VisualFeatures(fused=True)  # type: ignore[arg-type]
