"""Mirrored, turned and upside-down clips give mirrored answers."""

from __future__ import annotations

import pytest
import torch

import ndtorch
from ndtorch.vision import LocalFeatures, VisualFeatures
from ndtorch.vision.camera.front_end import CameraFrontEnd
from ndtorch.vision.camera.params import CameraParams
from ndtorch.vision.camera.sampling import every_other
from tests.vision.camera.passing_scenes import SIZE, passing

# Dimensions that are turned over, and which feature takes the place of which.
TURNS = {
    "mirrored": ((-1,), [1, 0, 2, 3, 4, 6, 5, 7, 8, 9]),
    "upside down": ((-2,), [0, 1, 3, 2, 4, 6, 5, 7, 8, 9]),
    "turned": ((-1, -2), [1, 0, 3, 2, 4, 5, 6, 7, 8, 9]),
}


@pytest.mark.parametrize("turn", TURNS)
def test_camera_front_end(turn: str) -> None:
    dims, order = TURNS[turn]
    noise = 0.02 * torch.randn(12, 3, *SIZE, generator=torch.Generator().manual_seed(0))
    video = (passing(12, 5.0, first=2) + noise).clamp(0, 1).double()
    module = CameraFrontEnd(SIZE, 25.0).double()
    (upright, _), (other, _) = module(video), module(video.flip(dims))
    fields = [dim - 1 for dim in dims]
    torch.testing.assert_close(other.signals.flip(fields)[..., order], upright.signals, atol=1e-5, rtol=0)
    torch.testing.assert_close(other.presence.flip(dims), upright.presence, atol=1e-5, rtol=0)
    signs = torch.tensor([-1.0 if -1 in dims else 1.0, -1.0 if -2 in dims else 1.0])
    torch.testing.assert_close(other.motion.flip(fields) * signs, upright.motion, atol=1e-7, rtol=0)
    assert upright.signals[..., :4].max() > 0.1


def test_objects_of_a_mirror_image() -> None:
    model = ndtorch.load("video", size=SIZE, fps=25.0)
    video = passing(50, 4.0)
    with torch.inference_mode():
        (thing,), (other,) = (model.objects(model(film)[1]) for film in (video, video.flip(-1)))
    assert (thing.direction, other.direction) == ("right", "left")
    path, mirrored = torch.tensor(thing.path), torch.tensor(other.path)
    mirrored[:, 1] = SIZE[1] - mirrored[:, 1]
    torch.testing.assert_close(mirrored, path, atol=0.05, rtol=0)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("border", ["wrap", "reflect"])
def test_motion_of_local_fields(turn: str, border: str) -> None:
    dims, order = TURNS[turn]
    video = passing(4, 5.0, first=1).double()
    module = LocalFeatures(VisualFeatures(SIZE, border=border), 8).double()
    (upright, _), (other, _) = module(video), module(video.flip(dims))
    back = other.flip([dim - 1 for dim in dims])[..., order]
    torch.testing.assert_close(back[..., :4], upright[..., :4], atol=1e-6, rtol=1e-5)


@pytest.mark.parametrize("size", [(56, 100), (5, 6), (7, 9), (4, 3), (1, 2)])
def test_every_other_pixel_of_a_mirror_image(size: tuple[int, int]) -> None:
    image = torch.rand(3, *size)
    assert torch.equal(every_other(image.flip(-1)), every_other(image).flip(-1))
    assert torch.equal(every_other(image.flip(-2)), every_other(image).flip(-2))
    assert every_other(torch.rand(56, 100)).shape == (28, 50)


def test_scale_of_a_fixed_level_too() -> None:
    video = passing(10, 5.0, first=2).double()
    for level in range(3):
        module = CameraFrontEnd(SIZE, 25.0, CameraParams(scale=level)).double()
        right, left = module(video)[0].motion, module(video.flip(-1))[0].motion.flip(-2)
        torch.testing.assert_close(left[..., 0], -right[..., 0], atol=1e-8, rtol=0)
