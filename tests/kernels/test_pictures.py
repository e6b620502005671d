"""What kernels make of a picture is what OpenCV and torch make of it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch
import torch.nn.functional as F

from ndtorch.kernels.field_sums import field_sums
from ndtorch.kernels.halved_colors import halved_colors
from ndtorch.kernels.softened import softened
from ndtorch.kernels.without_shadow import without_shadow
from ndtorch.vision._kernels_orientation import mirrored
from ndtorch.vision.camera.figures import shadow
from ndtorch.vision.camera.ground import GroundParams

pytest.importorskip("numba")
CHANCE = np.random.default_rng(5)


def test_a_halved_picture_is_that_of_opencv() -> None:
    picture = CHANCE.integers(0, 256, (26, 38, 3)).astype(np.uint8)
    planes = np.empty((3, 13, 19), np.float32)
    halved_colors(picture.reshape(26, -1), 1 / 255, planes)
    expected = np.asarray(cv2.resize(picture, (19, 13), interpolation=cv2.INTER_AREA)).transpose(2, 0, 1)
    assert np.array_equal(planes, expected * np.float32(1 / 255))


def test_a_blurred_picture_is_that_of_opencv() -> None:
    picture = CHANCE.random((3, 9, 14), dtype=np.float32)
    soft = np.empty_like(picture)
    softened(picture, soft)
    for plane, found in zip(picture, soft, strict=True):
        assert np.allclose(found, cv2.blur(plane, (3, 3)), rtol=0, atol=1e-7)


def test_mirrored_margins_are_those_of_torch() -> None:
    images = torch.from_numpy(CHANCE.random((2, 7, 11), dtype=np.float32))
    padded = np.empty((2, 7 + 2 * 6, 11 + 2 * 4), np.float32)
    mirrored(images.numpy(), 6, 4, padded)
    assert np.array_equal(padded, F.pad(images, (4, 4, 6, 6), mode="reflect").numpy())


@pytest.mark.parametrize("side", [3, 5])
def test_what_is_no_shadow_is_what_opencv_leaves(side: int) -> None:
    p = GroundParams(patch=side)
    # Even in some parts and uneven in others, at the edges of the picture too.
    light = (0.6 + 0.1 * CHANCE.random((40, 50)) * (np.arange(50) > 20)).astype(np.float32)
    may_be, out = (CHANCE.random((2, 40, 50)) < 0.9).astype(np.uint8)
    out[10:14], core = 0, np.empty((40, 50), np.uint8)
    without_shadow(out, light, may_be, p.patch, p.penumbra, p.darkest, 0.02, core)
    expected = out & ~shadow(light, may_be, GroundParams(patch=side, uneven=0.02))
    assert np.array_equal(core, expected)
    assert 0 < core.sum() < out.sum()


def test_what_is_sensed_of_a_mirrored_picture_is_mirrored_to_the_bit() -> None:
    picture, ground = CHANCE.random((2, 3, 20, 24), dtype=np.float32)
    slow, delayed = CHANCE.random((2, 3, 10, 12), dtype=np.float32)
    names = np.zeros((20, 24), np.int32)
    names[3:15, 5:14] = 2  # an edge within a block of two by two pixels

    def strongest(*images: np.ndarray) -> np.ndarray:
        found, given = np.empty((10, 12), np.float32), [image.copy() for image in images]
        field_sums(*given, 0.1, 0.4, found, np.empty((4, 6)))
        return found

    one = strongest(picture, ground, names, slow, delayed)
    other = strongest(*(image[..., ::-1] for image in (picture, ground, names, slow, delayed)))
    assert np.array_equal(one, other[:, ::-1])
    assert one.max() > 0
