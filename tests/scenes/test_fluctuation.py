"""Shadows and distance: ranges, periods, seeds, sizes."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from ndtorch.scenes import Bar, BarScene, Distance, RandomShadow, SineShadow

WHITE = (1.0, 1.0, 1.0)


def test_sine_shadow_is_the_published_pattern() -> None:
    light = SineShadow().light((500, 500))
    assert light.shape == (1, 1, 500)
    assert light.min().item() == pytest.approx(0.25, abs=1e-3)
    assert light.max().item() == pytest.approx(0.75, abs=1e-3)
    assert light[0, 0, 50].item() == pytest.approx(0.5)
    assert light[0, 0, 10].item() == pytest.approx(0.5 + 0.25 * math.sin(0.4 * math.pi))
    assert SineShadow(phase=90).light((8, 8))[0, 0, 0].item() == pytest.approx(0.75)


def test_random_shadow_is_two_wrapped_blurs_of_noise() -> None:
    light = RandomShadow(7).light((60, 80))[0]
    assert light.min().item() == pytest.approx(0.25)
    assert light.max().item() == pytest.approx(0.75)
    assert torch.equal(light, RandomShadow(7).light((60, 80))[0])
    assert not torch.equal(light, RandomShadow(8).light((60, 80))[0])

    noise = torch.rand((60, 80), generator=torch.Generator().manual_seed(7), dtype=torch.float64).numpy()
    for _ in range(2):
        for axis, n in enumerate(noise.shape):
            # Sampled over three turns on either side, so that what leaves one edge enters at the other.
            offsets = np.arange(-3 * n, 3 * n + 1)
            kernel = np.exp(-(offsets**2) / (2 * 6.0**2))
            shifted = [w * np.roll(noise, o, axis) for o, w in zip(offsets, kernel / kernel.sum(), strict=True)]
            noise = np.sum(shifted, axis=0)
    want = 0.25 + 0.5 * (noise - noise.min()) / (noise.max() - noise.min())
    np.testing.assert_allclose(light.numpy(), want, atol=1e-4)


def test_every_pixel_of_a_bar_takes_the_random_light_of_its_place() -> None:
    shadow = RandomShadow(2)
    image = BarScene([Bar(WHITE, 0, (45, 40))], 1.0, shadow, (80, 90)).frames(0, 1)[0, 1]
    light = shadow.light((80, 90))[0]
    assert torch.equal(image[20:60, 41:49], light[20:60, 41:49])


def test_distance_takes_a_bar_from_12_to_9_pixels_and_back() -> None:
    bars = [Bar(WHITE, 0, (45, 40), speed=0)]
    frames = BarScene(bars, 2.0, Distance(), (80, 90)).frames(0, 200)[:, 0].double()
    width, length = frames[:, 40].sum(-1), frames[:, :, 45].sum(-1)
    assert width[25].item() == pytest.approx(12, abs=1e-4)
    assert width[75].item() == pytest.approx(9, abs=1e-4)
    assert width[0].item() == pytest.approx(10.5, abs=1e-4)
    assert length[75].item() == pytest.approx(37.5, abs=1e-4)
    torch.testing.assert_close(width[:100], width[100:], rtol=0, atol=1e-5)
    area = frames.sum((-2, -1))
    torch.testing.assert_close(area, width * length, rtol=1e-5, atol=0)
