"""Regions of what stands out: those that hang together by little are cut."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.binding.tracking.regions import parted, regions_of, without_shadows
from tests.vision.camera.passing_scenes import SIZE, ground


def test_two_that_touch_side_by_side_are_cut_and_one_alone_is_not() -> None:
    picture = np.zeros((60, 80), bool)
    picture[10:40, 5:15] = True
    picture[12:40, 18:27] = True
    picture[35:40, 15:18] = True
    # One with a narrow neck, and a thing with a little one at its side.
    picture[44:48, 40:46] = True
    picture[48:58, 38:50] = True
    picture[10:40, 60:74] = True
    picture[30:32, 74:80] = True
    before = regions_of(picture, 10, 0)
    assert sorted(before.areas.tolist()) == [144, 432, 567]
    after = parted(before, 0.7, 10)
    neck, one, other, alone = sorted(after.areas.tolist())
    assert (neck, one + other, alone) == (144, 567, 432)
    # Both have their height, and what joined them goes to either.
    assert 252 <= one <= 267
    for r, (top, left, bottom, right) in enumerate(after.boxes.tolist()):
        rows, columns = np.nonzero(after.labels == r + 1)
        assert len(rows) == after.areas[r]
        assert (rows.min(), columns.min(), rows.max() + 1, columns.max() + 1) == (top, left, bottom, right)
    # What was given is as it was.
    assert (before.labels == regions_of(picture, 10, 0).labels).all()
    assert len(parted(before, 0.0, 10).areas) == 3


def test_kernels_find_and_cut_what_opencv_and_numpy_do() -> None:
    pytest.importorskip("numba")
    cv2 = pytest.importorskip("cv2")
    chance, cuts = np.random.default_rng(5), 0
    for trial in range(200):
        height, width = chance.integers(1, 50, 2)
        smooth = cv2.blur(chance.random((height, width)), tuple(int(side) for side in chance.integers(1, 9, 2)))
        figure = smooth.reshape(height, width) > chance.uniform(0.3, 0.7)
        # With holes, islands in holes, and what hangs together by a corner.
        gap = trial % 3
        plain = regions_of(figure, 2, gap)
        parts = parted(plain, 0.8, 2)
        with torch.inference_mode():
            quick = regions_of(figure, 2, gap)
            quick_parts = parted(quick, 0.8, 2)
        for one, other in zip((*plain, *parts), (*quick, *quick_parts), strict=True):
            assert np.array_equal(one, other)
        cuts += len(parts.areas) - len(plain.areas)
    assert cuts > 20


def test_a_region_that_may_be_nothing_but_a_narrow_shadow_is_one() -> None:
    picture, narrow = np.zeros((30, 50), bool), np.zeros((30, 50), np.uint8)
    picture[2:6, 3:23] = picture[10:20, 3:13] = picture[10:20, 30:40] = True
    narrow[2:6, 3:23] = narrow[10:20, 3:11] = 1
    before = regions_of(picture, 10, 0)
    after = without_shadows(before, narrow, 0.9)
    # Eight tenths of the second are not enough.
    assert sorted(after.boxes.tolist()) == [[10, 3, 20, 13], [10, 30, 20, 40]]
    for r, (top, left, bottom, right) in enumerate(after.boxes.tolist()):
        assert (after.labels[top:bottom, left:right] == r + 1).all()
    assert np.count_nonzero(after.labels) == after.areas.sum() == 200
    assert len(before.areas) == len(without_shadows(before, narrow, 1.0).areas) == 3
    assert len(without_shadows(before, narrow, 0.7).areas) == 1


def test_kernels_leave_out_the_shadows_that_numpy_does() -> None:
    pytest.importorskip("numba")
    chance, left_out = np.random.default_rng(6), 0
    for _ in range(50):
        picture, narrow = chance.random((20, 30)) > 0.7, (chance.random((20, 30)) > 0.3).astype(np.uint8)
        before = regions_of(picture, 1, 0)
        plain = without_shadows(before, narrow, 0.7)
        with torch.inference_mode():
            quick = without_shadows(before, narrow, 0.7)
        for one, other in zip(plain, quick, strict=True):
            assert np.array_equal(one, other)
        left_out += len(before.areas) - len(plain.areas)
    assert left_out > 50


@pytest.mark.parametrize(("blue", "objects"), [(0.0, 0), (0.4, 1)])
def test_a_narrow_shadow_that_passes_is_no_object_and_a_thing_of_its_form_is_one(blue: float, objects: int) -> None:
    """Four rows: all of it is edge, so that its light is as uneven as that of a thing."""
    frames = ground().repeat(50, 1, 1, 1)
    light = torch.tensor([0.8, 0.55, 0.55, 0.8])[:, None]
    for n in range(8, 50):
        part = frames[n, :, 50:54, (left := 4 * (n - 8)) : min(left + 40, SIZE[1])]
        part *= light
        part[2] += blue
    model = ndtorch.load("figures", size=SIZE, fps=25.0)
    with torch.inference_mode():
        _, state = model(frames)
    assert len(model.objects(state)) == objects


def test_a_broad_thing_that_is_darker_than_the_ground_everywhere_is_one() -> None:
    frames = ground().repeat(50, 1, 1, 1)
    coarse = torch.rand(12, 12, generator=torch.Generator().manual_seed(3))
    light = (0.4 + 0.5 * coarse).repeat_interleave(2, 0).repeat_interleave(2, 1)
    for n in range(8, 50):
        part = frames[n, :, 44:68, (left := 4 * (n - 8)) : min(left + 24, SIZE[1])]
        part *= light[:, : part.shape[2]]
    model = ndtorch.load("figures", size=SIZE, fps=25.0)
    with torch.inference_mode():
        _, state = model(frames)
    assert len(model.objects(state)) == 1
