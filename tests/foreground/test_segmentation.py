"""Background and foreground mask: light, noise, shadows, ghosts, and films that begin with objects in view."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch

from ndtorch.foreground.background import (
    BackgroundParams,
    BackgroundState,
    Segmentation,
    downscale,
    exposure_gain,
    is_ghost,
    learn,
    segment,
    start_background,
    without_shadow,
)
from tests.foreground.passing_scenes import SIZE, ground, passing

DT = 0.04
PARAMS = BackgroundParams()


def step(image: np.ndarray, state: BackgroundState) -> Segmentation:
    """One step, and what is learned at its end, without any object."""
    seen = segment(image, state, DT, PARAMS)
    learn(seen, np.zeros(SIZE, np.uint8), state, DT, PARAMS)
    return seen


def learned(image: np.ndarray, frames: int = 40) -> BackgroundState:
    state = start_background(image, PARAMS)
    for _ in range(frames):
        step(image, state)
    return state


@pytest.mark.parametrize("size", [(12, 16), (11, 13)])
def test_frames_are_averaged_however_their_colors_lie(size: tuple[int, int]) -> None:
    beside = np.random.default_rng(0).integers(0, 256, (24, 32, 3), np.uint8)
    frame = torch.from_numpy(beside).permute(2, 0, 1)
    found = downscale(frame, size)
    expected = np.asarray(cv2.resize(beside, size[::-1], interpolation=cv2.INTER_AREA)).transpose(2, 0, 1) / 255
    assert np.allclose(found, expected, atol=1 / 255)
    assert np.array_equal(downscale(frame.contiguous(), size), found)
    assert np.allclose(downscale(frame / 255, size), found, atol=1 / 255)


def test_another_scene_begins_anew_and_another_light_does_not() -> None:
    still = ground(1).numpy()

    def cut(image: np.ndarray) -> bool:
        return segment(image.astype(np.float32), learned(still, 20), DT, PARAMS).cut

    assert not cut(still)
    assert not cut(still * 0.6)
    assert not cut(np.clip(1.3 * still, 0, 1))
    assert cut(1.6 * ground(2).numpy() - 0.2)


def test_the_exposure_is_the_median_ratio_of_each_color() -> None:
    still = ground(1).numpy()
    brighter = still * np.array([1.2, 1.1, 0.8], np.float32)[:, None, None]
    brighter[:, :40, :60] = 1.0
    assert exposure_gain(brighter, still) == pytest.approx([1.2, 1.1, 0.8], rel=1e-5)
    assert exposure_gain(still, 0 * still) == pytest.approx([1, 1, 1])


def test_what_moves_in_view_from_the_first_frame_stands_out_and_leaves_no_hole() -> None:
    frames = passing(40, 3.0, first=0)
    state, shares = start_background(frames[0].numpy(), PARAMS), []
    for n, frame in enumerate(frames.numpy()):
        seen = step(frame, state)
        true = np.zeros(SIZE, bool)
        true[44:68, 3 * n : 3 * n + 24] = True
        shares.append((seen.mask[true].mean(), seen.mask[~true].mean()))
    assert max(outside for _, outside in shares) < 0.03
    # Once the background under it is known, all of it stands out, and the place where it began does not.
    assert shares[-1][0] > 0.8
    assert state.known[44:68, :24].all()
    assert np.abs(state.mean[:, 44:68, :20] - frames[-1][:, 44:68, :20].numpy()).max() < 0.02


def test_noise_is_no_motion_and_the_background_is_known_in_the_end() -> None:
    generator = torch.Generator().manual_seed(3)
    still = ground()
    state = start_background(still.numpy(), PARAMS)
    for _ in range(60):
        seen = step((still + 0.04 * torch.randn(still.shape, generator=generator)).numpy(), state)
    assert state.known.mean() > 0.95
    assert seen.mask.mean() < 0.01
    assert 0.03 < np.median(seen.sigma) < 0.09


def test_a_loss_of_light_is_a_shadow_and_an_object_is_none() -> None:
    still = ground(1).numpy() * np.array([1.0, 0.9, 0.8], np.float32)[:, None, None]
    image, mask = still.copy(), np.zeros(SIZE, np.uint8)
    image[:, 30:60, 20:70] *= 0.6
    image[:, 30:60, 100:150] = np.array([0.2, 0.3, 0.6])[:, None, None]
    mask[30:60, 20:70] = mask[30:60, 100:150] = 1
    left = without_shadow(mask, image, still, PARAMS)
    assert left[30:60, 20:70].mean() < 0.02
    assert left[30:60, 100:150].all()
    # Without color, an object that is darker by so much cannot be told from a shadow.
    grey, dark = ground(1).numpy(), ground(1).numpy()
    dark[:, 30:60, 20:70] *= 0.6
    assert np.array_equal(without_shadow(mask, dark, grey, PARAMS), mask)


def test_a_ghost_has_its_edges_in_the_background() -> None:
    empty, full = ground().numpy(), ground().numpy()
    full[:, 44:68, 60:84] = 0.9
    region = np.zeros(SIZE, np.uint8)
    region[44:68, 60:84] = 1
    assert is_ghost(region, 0 * region, empty, full)
    assert not is_ghost(region, 0 * region, full, empty)
