"""Blobs of what stands out: those that hang together by little are cut."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.tracking.blobs import cast_shadows, connected_components, split_blobs
from tests.foreground.passing_scenes import SIZE, ground


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
    before = connected_components(picture, 10, 0)
    assert sorted(before.areas.tolist()) == [144, 432, 567]
    after = split_blobs(before, 0.7, 10)
    neck, one, other, alone = sorted(after.areas.tolist())
    assert (neck, one + other, alone) == (144, 567, 432)
    # Both have their height, and what joined them goes to either.
    assert 252 <= one <= 267
    for r, (top, left, bottom, right) in enumerate(after.boxes.tolist()):
        rows, columns = np.nonzero(after.labels == r + 1)
        assert len(rows) == after.areas[r]
        assert (rows.min(), columns.min(), rows.max() + 1, columns.max() + 1) == (top, left, bottom, right)
    # What was given is as it was.
    assert (before.labels == connected_components(picture, 10, 0).labels).all()
    assert len(split_blobs(before, 0.0, 10).areas) == 3


def test_components_are_those_of_opencv_with_what_they_enclose() -> None:
    chance = np.random.default_rng(5)
    for trial in range(100):
        height, width = (int(side) for side in chance.integers(1, 50, 2))
        smooth = cv2.blur(chance.random((height, width)), tuple(int(side) for side in chance.integers(1, 9, 2)))
        mask = smooth.reshape(height, width) > chance.uniform(0.3, 0.7)
        # With holes, islands in holes, and what hangs together by a corner.
        gap = trial % 3
        closed = mask.astype(np.uint8)
        if gap:
            closed = cv2.morphologyEx(closed, cv2.MORPH_CLOSE, np.ones((gap + 1, gap + 1), np.uint8))
        outlines, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        filled = cv2.drawContours(closed.copy(), outlines, -1, 1, cv2.FILLED)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(filled, connectivity=8)
        wanted = [r for r in range(1, count) if stats[r, 4] >= 2]
        blobs = connected_components(mask, 2, gap)
        assert blobs.areas.tolist() == [stats[r, 4] for r in wanted]
        for n, r in enumerate(wanted):
            left, top, wide, tall, _ = stats[r]
            assert blobs.boxes[n].tolist() == [top, left, top + tall, left + wide]
            assert np.array_equal(blobs.labels == n + 1, labels == r)


@pytest.mark.parametrize(("blue", "objects"), [(0.0, 0), (0.4, 1)])
def test_a_narrow_shadow_that_passes_is_no_object_and_a_thing_of_its_form_is_one(blue: float, objects: int) -> None:
    """Four rows: all of it is edge, so that its light is as uneven as that of a thing."""
    colored = ground() * torch.tensor([1.0, 0.9, 0.8])[:, None, None]
    assert objects_of_a_strip(colored, blue) == objects


def test_a_narrow_shadow_beside_its_object_is_cut_off_and_dark_legs_below_a_body_are_not() -> None:
    body, legs, shadow = np.zeros((3, 60, 80), bool)
    body[10:30, 20:30], legs[30:40, 22:25], shadow[38:42, 25:60] = True, True, True
    mask, narrow = body | legs | shadow, (legs | shadow).astype(np.uint8)
    cast = cast_shadows(connected_components(mask, 10, 0), mask, narrow)
    assert cast is not None
    assert not (cast & (body | legs)).any()
    assert cast[:, 32:].sum() == shadow[:, 32:].sum()
    assert cast_shadows(connected_components(body | legs, 10, 0), body | legs, legs.astype(np.uint8)) is None


def test_in_a_film_without_colors_a_narrow_dark_thing_is_an_object() -> None:
    assert objects_of_a_strip(ground(), 0.0) == 1


def objects_of_a_strip(still: torch.Tensor, blue: float) -> int:
    """Which takes light from a still, and adds some blue."""
    frames = still.repeat(50, 1, 1, 1)
    light = torch.tensor([0.8, 0.55, 0.55, 0.8])[:, None]
    for n in range(8, 50):
        part = frames[n, :, 50:54, (left := 4 * (n - 8)) : min(left + 40, SIZE[1])]
        part *= light
        part[2] += blue
    model = ndtorch.load("foreground", size=SIZE, fps=25.0)
    with torch.inference_mode():
        _, state = model(frames)
    return len(model.objects(state))


def test_a_broad_thing_that_is_darker_than_the_ground_everywhere_is_one() -> None:
    frames = ground().repeat(50, 1, 1, 1)
    coarse = torch.rand(12, 12, generator=torch.Generator().manual_seed(3))
    light = (0.4 + 0.5 * coarse).repeat_interleave(2, 0).repeat_interleave(2, 1)
    for n in range(8, 50):
        part = frames[n, :, 44:68, (left := 4 * (n - 8)) : min(left + 24, SIZE[1])]
        part *= light[:, : part.shape[2]]
    model = ndtorch.load("foreground", size=SIZE, fps=25.0)
    with torch.inference_mode():
        _, state = model(frames)
    assert len(model.objects(state)) == 1
