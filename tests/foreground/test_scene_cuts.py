"""Cuts, black starts and fades: they are noticed, and what passes afterwards is seen at once."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

import ndtorch
from tests.foreground.passing_scenes import SIZE, ground

FPS = 25.0


def filmed(seed: int, frames: int) -> Tensor:
    """A red square passes to the right again and again over a ground of its own, `[T, 3, H, W]`."""
    place = ground(seed) + 0.1 * (seed % 3)
    video = place.repeat(frames, 1, 1, 1)
    for n in range(frames):
        left = 4 * (n % 50)
        video[n, :, 44:68, left : left + 24] = torch.tensor([0.8, 0.2, 0.2])[:, None, None]
    return video


def sensor(video: Tensor) -> Tensor:
    """As a camera with a little noise gives it."""
    noise = 0.01 * torch.randn(video.shape, generator=torch.Generator().manual_seed(5))
    return ((video + noise).clamp(0, 1) * 255).round().to(torch.uint8)


def black(frames: int) -> Tensor:
    return torch.zeros(frames, 3, *SIZE)


def contrasty(video: Tensor) -> Tensor:
    """Twice the contrast. Two scenes that differ in less than the share `cut` of the picture are not told apart."""
    return ((video - 0.45) * 2 + 0.45).clamp(0, 1)


CASES = {
    "cut": (torch.cat([filmed(1, 60), contrasty(filmed(2, 60))]), 60),
    "three black frames": (torch.cat([black(3), filmed(1, 60)]), 3),
    "a second of black": (torch.cat([black(25), filmed(1, 60)]), 25),
    "black in between": (torch.cat([filmed(1, 40), black(10), filmed(1, 60)]), 50),
    "fade": (filmed(1, 110) * (torch.arange(110) / 50).clamp_max(1)[:, None, None, None], 50),
}


@pytest.mark.parametrize("name", CASES)
def test_what_passes_after_a_new_scene_is_seen_within_a_second(name: str) -> None:
    video, first = CASES[name]
    model = ndtorch.load("foreground", size=SIZE, fps=FPS)
    with torch.inference_mode():
        signals, state = model(sensor(video))
    later = [t for thing in model.objects(state) for t, *_ in thing.path if t >= first / FPS]
    assert later
    assert min(later) - first / FPS < 0.8
    cuts = signals.time[signals.cut]
    assert 1 <= len(cuts) <= 6
    # The last one is the scene that stays; a fade is told on its way.
    assert first / FPS - 2 < cuts[-1] <= first / FPS + 1e-9


def test_nothing_that_passes_or_darkens_is_a_cut() -> None:
    dimmed = filmed(1, 75) * (1 - 0.4 * torch.sin(torch.arange(75) / 12))[:, None, None, None]
    large = filmed(1, 75)
    for n in range(20, 75):
        large[n, :, :, max(0, 5 * n - 180) : 5 * n - 100] = 0.9
    for video in (dimmed, large):
        model = ndtorch.load("foreground", size=SIZE, fps=FPS)
        with torch.inference_mode():
            signals, _ = model(sensor(video))
        assert not signals.cut.any()
