"""Track and ground: kernels do what their references do, and a film may begin with objects in view."""

from __future__ import annotations

import copy
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from ndtorch.foreground._kernels import CleaningSides, MaskImages, clean_mask
from ndtorch.foreground.arrays import aligned_copy
from ndtorch.foreground.background import BackgroundModel, BackgroundParams, update_background
from ndtorch.foreground.morphology import inside_row, pack, unpack
from ndtorch.foreground.noise import MEAN_SIZE, MEDIAN_SIZE, MotionLimits, motion_and_noise
from ndtorch.foreground.segmentation import Segmentation, segment
from ndtorch.foreground.shadow import PENUMBRA_PX, WINDOW_PX, ShadowLimits, remove_shadow
from tests.foreground.passing_scenes import SIZE, ground, passing

DT = 0.04
PARAMS = BackgroundParams()


def step(picture: Any, model: BackgroundModel) -> Segmentation:
    """One step, and what is learned at its end, without any object."""
    seen = segment(picture, model, DT, PARAMS)
    update_background(model, seen.image, seen.noise, np.zeros(SIZE, np.float32), DT, PARAMS)
    return seen


def test_another_scene_begins_anew_and_another_light_does_not() -> None:
    still = ground(1).numpy()
    state = BackgroundModel.start(still, PARAMS)
    for _ in range(10):
        seen = step(still, state)

    def cut(picture: Any) -> bool:
        return segment(picture, copy.deepcopy(state), DT, PARAMS).scene_cut

    assert not seen.scene_cut
    # Darker, and through another curve; not what is nearly black.
    assert not cut(still * np.float32(0.4))
    assert not cut(np.asarray(np.clip(1.3 * still, 0, 1) ** np.float32(0.8), np.float32))
    assert cut(still * np.float32(0.1))
    assert cut(np.asarray(1.6 * ground(2).numpy() - 0.2, np.float32))


def test_what_moves_in_view_from_the_first_frame_stands_out_and_leaves_no_hole() -> None:
    frames = passing(40, 3.0, first=0)
    state, shares = BackgroundModel.start(frames[0].numpy(), PARAMS), []
    for n, frame in enumerate(frames.numpy()):
        seen = step(frame, state)
        true = np.zeros(SIZE, bool)
        true[44:68, 3 * n : 3 * n + 24] = True
        shares.append((seen.mask[true].mean(), seen.mask[~true].mean()))
    # Its plain inside is still, but its edges stand out at once.
    assert min(inside for inside, _ in shares[2:]) > 0.2
    assert max(outside for _, outside in shares) < 0.03
    # Once the ground under it is known, all of it does, and the place where it began does not.
    assert shares[-1][0] > 0.8
    assert state.initialised[44:68, :24].all()
    assert np.abs(state.mean[:, 44:68, :20] - frames[-1][:, 44:68, :20].numpy()).max() < 0.02


def test_noise_is_no_motion_and_ground_is_known_in_the_end() -> None:
    generator = torch.Generator().manual_seed(3)
    still = passing(1, 1.0, first=9)[0]
    state = BackgroundModel.start(still.numpy(), PARAMS)
    for _ in range(30):
        noisy = (still + 0.04 * torch.randn(still.shape, generator=generator)).numpy()
        seen = step(noisy, state)
    assert state.initialised.mean() > 0.95
    assert seen.mask.mean() < 0.01
    # What never comes to rest is ground by and by: leaves.
    flicker = still.clone()
    for n in range(250):
        flicker[:, 20:40, 20:60] = 0.3 + 0.4 * (n % 2)
        seen = step(flicker.numpy(), state)
    assert state.initialised.all()
    assert not seen.mask.any()


def shadow_by_opencv(light: Any, candidates: Any, limits: ShadowLimits) -> Any:
    """1 where the image is the background with less light, evenly among neighbours."""
    side = (WINDOW_PX, WINDOW_PX)
    mean = cv2.blur(light, side)
    variance = cv2.blur(light * light, side) - mean * mean
    inner = candidates * ((mean > limits.min_ratio) & (variance < limits.max_variation**2))
    edge = np.ones((2 * PENUMBRA_PX + 1, 2 * PENUMBRA_PX + 1), np.uint8)
    return cv2.dilate(inner.astype(np.uint8), edge) & candidates


def test_shadow_is_what_opencv_finds() -> None:
    """Even in some parts and uneven in others, at the edges of the image too."""
    chance, limits = np.random.default_rng(5), ShadowLimits(PARAMS.shadow_min_ratio, 0.02)
    light = (0.6 + 0.1 * chance.random((40, 50)) * (np.arange(50) > 20)).astype(np.float32)
    shadow, candidates = (chance.random((2, 40, 50)) < 0.9).astype(np.uint8)
    candidates[10:14], core, inside = 0, np.empty((40, 50), np.uint8), inside_row(50, 5)
    bits = np.zeros((50, len(inside)), np.uint64)
    for row, to in zip(candidates, bits[5:], strict=False):
        pack(row, to)
    remove_shadow(bits.ravel(), light, shadow, limits, inside, 5, (bits.ravel().copy(), bits.ravel().copy()))
    for row, to in zip(bits[5:], core, strict=False):
        unpack(row, to)
    assert np.array_equal(core, candidates & ~shadow_by_opencv(light, shadow, limits))
    assert 0 < core.sum() < candidates.sum()


def majority(image: Any) -> Any:
    return (cv2.blur(image * np.uint8(255), (3, 3)) > 127).astype(np.uint8)


@pytest.mark.parametrize(("closing", "moving"), [(5, 5), (3, 19), (9, 1)])
@pytest.mark.parametrize("colored", [True, False])
@pytest.mark.parametrize("known", [1.0, 0.6])
def test_the_mask_is_cleaned_as_opencv_does(closing: int, moving: int, colored: bool, known: float) -> None:
    chance, size, trail = np.random.default_rng(4), (92, 121), 0.1
    limits = ShadowLimits(PARAMS.shadow_min_ratio, PARAMS.shadow_max_variation_ratio)
    light = chance.normal(0.6, 0.05, size).astype(np.float32)
    light[10:30, 20:50] = 0.5
    # In patches, so that something is left when specks are taken away, and of all kinds at the edges, too.
    patches = [cv2.blur(chance.random(size), (side, side)) for side in (5, 9, 15)]
    initialised = (patches[1] < np.quantile(patches[1], known)).astype(np.float32)
    static = (patches[2] - 0.4).astype(np.float32)
    out, may_be = (patches[0] > 0.52).astype(np.uint8), (chance.random(size) < 0.7).astype(np.uint8)
    pale = may_be & (chance.random(size) < 0.8)
    image, found = np.zeros((3, *size), np.float32), [np.empty(size, np.uint8) for _ in range(2)]
    sides = CleaningSides(closing, moving, 3, 9 if colored else 0)
    images = MaskImages(image, light, light, out.copy(), may_be, pale)
    clean_mask(images, initialised, int((initialised <= 0).sum()), static, trail, limits, sides, *found)

    def morph(marks: Any, how: int, side: int) -> Any:
        return np.asarray(cv2.morphologyEx(marks, how, np.ones((side, side), np.uint8)), np.uint8)

    sure = (initialised > 0).astype(np.uint8)
    candidates = out & sure
    mask = morph(candidates & ~shadow_by_opencv(light, may_be, limits), cv2.MORPH_CLOSE, closing) & candidates
    young = ((static < np.float32(trail)) & (sure == 0)).astype(np.uint8)
    mask |= morph(young, cv2.MORPH_OPEN, moving)
    mask = morph(majority(mask), cv2.MORPH_OPEN, 3)
    narrow = pale & sure & (1 - morph(mask, cv2.MORPH_OPEN, 9)) if colored else 0 * sure
    assert np.array_equal(found[0], mask)
    assert np.array_equal(found[1], narrow)
    assert 100 < mask.sum() < out.sum()
    assert narrow.any() == colored


@pytest.mark.parametrize(("size", "known"), [((48, 64), 1.0), ((44, 60), 0.5)])
def test_motion_is_change_above_the_noise_and_its_neighbours_move_along(size: tuple[int, int], known: float) -> None:
    chance, limits = np.random.default_rng(5), MotionLimits(DT, 0.012, 3.0, 0.2, 3.0)
    previous = chance.random((3, *size)).astype(np.float32)
    image = previous + chance.normal(0, 0.012, previous.shape).astype(np.float32)
    image[:, 8:24, 16:40] += 0.2
    previous, wanted = (np.stack([cv2.blur(plane, (3, 3)) for plane in one]) for one in (previous, image))
    blurred = np.empty_like(image)
    flicker, static = (aligned_copy(plane) for plane in (chance.uniform(0, 0.01, size), chance.random(size)))
    initialised = (chance.random(size) < known).astype(np.float32)
    candidates = (chance.random(size) < 0.6).astype(np.uint8)
    own, before = flicker.copy(), static.copy()
    unknown = int((initialised <= 0).sum())
    changed = motion_and_noise(image, blurred, previous, flicker, static, initialised, unknown, candidates, limits)
    assert np.allclose(blurred, wanted, atol=1e-6)

    change = np.abs(blurred - previous).mean(0)
    rows, columns = ((n + 1) // 2 for n in size)
    turned = (change, change[::-1], change[:, ::-1], change[::-1, ::-1])
    noise = np.median(np.concatenate([one[:rows:4, :columns:4].ravel() for one in turned])) / MEDIAN_SIZE
    least = np.maximum(noise, own / MEAN_SIZE)
    over = (change > np.maximum(0.012, 3 * least)).astype(np.uint8)
    moved = majority(over) | majority(candidates) * (initialised == 0)
    still = cv2.dilate(moved, np.ones((3, 3), np.uint8)) == 0
    assert np.allclose(static, (before + DT) * still, atol=1e-6)
    assert np.allclose(flicker, own + 0.2 * (np.minimum(change, 3 * least) - own), atol=1e-6)
    if size[0] % 8:
        assert changed == -1
    else:
        blocks = (blurred - previous).reshape(3, size[0] // 8, 8, size[1] // 8, 8).mean((2, 4))
        assert changed == pytest.approx((np.abs(blocks).max(0) > 0.02).mean())


@pytest.mark.parametrize(("kept", "pace"), [(0, 1.0), (1, PARAMS.object_learning_ratio), (3, 0.0)])
def test_the_noise_under_an_object_is_learned_slowly_and_not_at_all_under_a_parked_one(kept: int, pace: float) -> None:
    model = BackgroundModel.start(np.full((3, *SIZE), 0.5, np.float32), PARAMS)
    model.initialised[...] = 1
    image, noise = model.mean + np.float32(0.01), np.full(3, 0.02, np.float32)
    before, mean = model.deviation.copy(), model.mean.copy()
    update_background(model, image, noise, np.full(SIZE, kept, np.float32), DT, PARAMS)
    # Of the first frames the mean is learned: a sixth at the first.
    assert model.deviation - before == pytest.approx(pace / 6 * (0.01 - before), abs=1e-6)
    follows = (PARAMS.object_learning_ratio if kept else 1.0) * (1 - np.exp(-DT / PARAMS.tau_background))
    assert model.mean - mean == pytest.approx(follows * 0.01, abs=1e-6)
