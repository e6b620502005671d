"""Hues, and shades of what has none."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import ndtorch
from ndtorch.binding import BoundObject
from ndtorch.vision.camera.colors import SHADES, hues_and_shades
from ndtorch.vision.camera.params import CameraParams
from tests.vision.camera.passing_scenes import SIZE, passing


def objects(video: Tensor) -> list[BoundObject]:
    noise = 0.01 * torch.randn(len(video), 1, *SIZE, generator=torch.Generator().manual_seed(3))
    grey = ((video + noise).clamp(0, 1) * 255).round().to(torch.uint8)
    # As a codec returns it: the planes of a grey picture differ by a step of rounding here and there.
    grey[:, 2, ::3, ::2] += 1
    model = ndtorch.load("video", size=SIZE, fps=25.0)
    with torch.inference_mode():
        found = model.objects(model(grey)[1])
    assert isinstance(found, list)
    return found


@pytest.mark.parametrize(("light", "name"), [(0.95, "white"), (0.03, "black"), (0.28, "grey")])
def test_a_grey_thing_is_one_object_with_a_name_and_its_direction(light: float, name: str) -> None:
    for video, direction in (
        (passing(50, 4.0, (light,) * 3), "right"),
        (passing(50, 4.0, (light,) * 3).flip(-1), "left"),
    ):
        (thing,) = objects(video)
        assert (thing.color, thing.direction) == (name, direction)
        assert not {"red", "green", "blue"} & set(thing.features)


def test_a_large_plain_grey_thing_is_one_object() -> None:
    """Its front and its back are far apart, and all that they have in common is that they are grey."""
    video = passing(70, 4.0, (0.9, 0.9, 0.9))
    for n in range(8, 70):
        left = 4 * (n - 8) - 90
        video[n, :, 30:80, max(0, left) : max(0, left + 90)] = 0.9
    (thing,) = objects(video)
    assert (thing.color, thing.direction) == ("white", "right")


def test_what_has_a_hue_keeps_it() -> None:
    (thing,) = objects(passing(50, 4.0, (0.8, 0.2, 0.2)))
    assert (thing.color, thing.shade) == ("red", None)


def test_shades_and_the_share_with_a_hue_add_up_to_one() -> None:
    ground = torch.full((3, 16, 16), 0.5)
    frame = ground.clone()
    frame[:, :4, :4], frame[:, :4, 8:12], frame[0, 8:12, :4] = 1.0, 0.02, 0.9
    hue, shade = hues_and_shades(frame, ground, CameraParams())
    torch.testing.assert_close(shade.sum(0), torch.ones(16, 16))
    names = [SHADES[int(shade[:3, row, column].argmax())] for row, column in ((0, 0), (0, 8), (15, 15))]
    assert names == ["white", "black", "grey"]
    assert hue[0, 8, 0] > 0.2
    assert shade[3].nonzero().tolist() == [[row, column] for row in range(8, 12) for column in range(4)]
