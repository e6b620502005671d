"""What is pale is an object when it moves as a whole, and what stands out is one anyway."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

import ndtorch
from ndtorch.binding import BoundObject
from ndtorch.binding.models.foreground import ForegroundModel
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.rigid_motion import (
    compare_patches,
    confidence,
    is_rigid_motion,
    revoke_confirmation,
    update_appearance_match,
)
from ndtorch.tracking.track import Track
from tests.foreground.passing_scenes import SIZE, ground

P = TrackingParams()
STILL = np.zeros((50, 80), np.uint8)
"""Nothing swings."""
LIGHT = 0.4
GROUND = np.full((3, 4, 4), LIGHT, np.float32)


def textured(contrast: float, side: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    chance = np.random.default_rng(0)
    return (contrast * (1 + 0.3 * chance.standard_normal((3, side, side)))).astype(np.float32)


def followed(lefts: list[int], shown: list[int], contrast: float) -> Track:
    """A track whose box begins at these columns; the thing itself is at others."""
    one, thing = Track.begin(0, 0.0, np.array([0.5, 0.2])), textured(contrast, 20)
    one.extent, plain = 2 * (0.2,), np.full((3, 100, 160), LIGHT, np.float32)
    for n, (left, at) in enumerate(zip(lefts, shown, strict=True)):
        picture = plain.copy()
        picture[:, 40:60, at : at + 20] += thing
        box = (0.4, left / 100, 0.6, left / 100 + 0.2)
        one.new_detections.append((float(n), 0.5, left / 100 + 0.1, *box, 0.04, 0.5, left / 100 + 0.1))
        update_appearance_match(one, picture, plain)
    return one


@pytest.mark.parametrize("contrast", [0.03, 0.2])
def test_what_goes_along_with_its_box_moves_as_a_whole(contrast: float) -> None:
    places = list(range(10, 90, 10))
    one = followed(places, places, contrast)
    stayed, went = one.appearance_error
    assert went < 0.1 * stayed
    assert is_rigid_motion(one, LIGHT) is (contrast > 0.1)
    # What is pale needs more of that, and a darker scene has smaller differences.
    assert is_rigid_motion(one, LIGHT / 4)


def patch_of(image: Any, background: Any, box: tuple[int, ...]) -> Any:
    """The difference from the background in a box, by OpenCV; what lies outside the image is left out."""
    height, width = image.shape[1:]
    top, left = min(max(box[0], 0), height - 1), min(max(box[1], 0), width - 1)
    bottom, right = min(max(box[2], top + 1), height), min(max(box[3], left + 1), width)
    apart = image[:, top:bottom, left:right] - background[:, top:bottom, left:right]
    how = cv2.INTER_AREA if min(apart.shape[1:]) > 12 else cv2.INTER_LINEAR
    return np.stack([cv2.resize(plane, (12, 12), interpolation=how) for plane in apart])


def test_patches_are_those_of_opencv() -> None:
    """Shrunk, enlarged, both, and partly outside."""
    chance = np.random.default_rng(6)
    image, plain = (chance.random((3, 50, 80)).astype(np.float32) for _ in range(2))
    patch = chance.random((3, 12, 12)).astype(np.float32)
    sides = [
        (0, 0, 24, 24),
        (3, 5, 40, 22),
        (10, 10, 14, 13),
        (7, 9, 19, 60),
        (-5, -9, 9, 30),
        (44, 70, 60, 99),
        (9, 9, 9, 9),
    ]
    boxes = [[side / 50 for side in box] for box in sides]
    first, distances = compare_patches(boxes, patch, image, plain)
    patches = [patch_of(image, plain, box) for box in sides]
    assert np.allclose(first, patches[0], atol=1e-5)
    assert distances == pytest.approx([float(((one - patch) ** 2).mean()) for one in patches], rel=1e-4)


def walked(columns: list[float], dt: float = 0.1) -> Track:
    """A track of size .2 that was at these columns, one after the other."""
    one = Track.begin(0, 0.0, np.array([0.5, columns[0]]))
    one.extent = 2 * (0.2,)
    for n, at in enumerate(columns):
        one.new_detections.append((n * dt, 0.5, at, 0.4, at - 0.1, 0.6, at + 0.1, 0.04, 0.5, at))
    return one


TO_AND_FRO = [0.5, 0.6, 0.7, 0.6, 0.5]
STRAIGHT = [0.5, 0.6, 0.7, 0.8, 0.9]


def test_an_object_that_only_went_to_and_fro_is_taken_back_within_its_trial() -> None:
    swaying, walking, cluttered = walked(TO_AND_FRO * 4), walked(STRAIGHT), np.ones((56, 100), np.float32)
    times = [n / 10 for n in range(1, 101)]
    for one, most in ((swaying, P.probation_s), (walking, 0.0)):
        one.confirmed_at = 0.0
        back = [time for time in times if revoke_confirmation(one, cluttered, STILL, time, 0.1, P)]
        # Once a second, and not later than that.
        assert back == [float(n) for n in range(1, int(most) + 1)]
    assert not revoke_confirmation(swaying, cluttered, STILL, 1.0, 0.1, TrackingParams(min_travel_sizes=0.0))
    assert not revoke_confirmation(swaying, 0 * cluttered, STILL, 1.0, 0.1, P)


def test_where_something_swings_an_object_that_only_goes_to_and_fro_is_taken_back_at_any_time() -> None:
    swaying, walking, uncluttered = walked(TO_AND_FRO * 4), walked(STRAIGHT), np.zeros((56, 100), np.float32)
    beside, there = STILL.copy(), STILL.copy()
    beside[:, :20], there[20:30, 18:35] = 1, 1
    for one in (swaying, walking):
        one.confirmed_at = 0.0
        assert not any(revoke_confirmation(one, uncluttered, beside, time, 0.1, P) for time in (0.5, 3.0, 9.5))
        back = [revoke_confirmation(one, uncluttered, there, time, 0.1, P) for time in (0.5, 3.0, 9.5)]
        assert back == 3 * [one is swaying]


def objects(video: Tensor, **options: float) -> list[BoundObject]:
    """On a camera with some noise; `options` are of the tracking."""
    generator = torch.Generator().manual_seed(3)
    noisy = video + 0.004 * torch.randn(video.shape, generator=generator)
    named = {f"tracking.{name}": value for name, value in options.items()}
    model = ndtorch.load("foreground", size=SIZE, fps=25.0, **named)
    assert isinstance(model, ForegroundModel)
    with torch.inference_mode():
        _, state = model((noisy.clamp(0, 1) * 255).round().to(torch.uint8))
    found = model.objects(state)
    assert isinstance(found, list)
    return [one for one in found if isinstance(one, BoundObject)]


def pale(kind: str) -> Tensor:
    """A pale square of 24 pixels that goes to the right, or four of 12 side by side that come and go in turn."""
    video = ground().repeat(75, 1, 1, 1)
    for n in range(30, 75):
        if kind == "goes":
            video[n, :, 44:68, 4 * (n - 30) : 4 * (n - 30) + 24] += 0.05
            continue
        for k in range(4):
            # Two neighbours at a time; the whole seems to go along.
            if (n - 30) // 8 % 4 in (k, (k - 1) % 4):
                video[n, :, 44:56, 60 + 12 * k : 72 + 12 * k] += 0.04
    return video


def test_pale_blocks_that_come_and_go_are_no_object_but_a_pale_thing_that_moves_is() -> None:
    (thing,) = objects(pale("goes"))
    assert thing.direction == "right"
    assert objects(pale("blinks")) == []


def cut_to(left: int) -> Tensor:
    """A spot that shines, and from frame 45 on a screen of which it was a part; the screen begins at that column."""
    video = ground().repeat(90, 1, 1, 1)
    video[30:45, :, 44:54, 20:30] = 0.9
    video[45:, :, 40:88, left : left + 60] = 0.9
    return video


def test_a_spot_that_becomes_a_screen_is_no_object() -> None:
    """Its middle goes by more than its size, but nothing moves."""
    assert objects(cut_to(20)) == []
    assert len(objects(cut_to(20), max_area_ratio=1e9, probation_s=0.0)) == 1


def test_what_crosses_has_more_confidence_than_what_swings_in_its_place() -> None:
    crossing, swinging = list(range(10, 90, 10)), [40, 60, 40, 20] * 2
    across, swings = (confidence(followed(places, places, 0.2)) for places in (crossing, swinging))
    assert 0 < swings < across < 1
    assert confidence(followed([40] * 8, [40] * 8, 0.2)) == 0
