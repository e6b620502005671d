"""White, grey and black of what has no hue."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ndtorch.binding.tracking.shades import Light, ShadeParams, shade_of


def light(tint: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Light:
    """Over grey ground of .4, with a white patch of .9 in view."""
    ground = np.full((3, 32, 40), 0.4, np.float32)
    picture = ground.copy()
    picture[:, 8:16, 8:16] = 0.9
    color = np.array(tint, np.float32)[:, None, None]
    return Light(picture * color, ground * color, ShadeParams())


def pixels(*color: float) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    return np.repeat(np.array(color, np.float32)[:, None], 40, 1)


@pytest.mark.parametrize(
    ("color", "name"),
    [
        ((0.85, 0.85, 0.85), "white"),
        ((0.3, 0.3, 0.3), "grey"),
        ((0.05, 0.05, 0.05), "black"),
        ((0.8, 0.2, 0.2), None),
        ((0.3, 0.35, 0.6), None),
        # A tinge is none.
        ((0.8, 0.83, 0.85), "white"),
    ],
)
@pytest.mark.parametrize("tint", [(1.0, 1.0, 1.0), (1.0, 0.9, 0.75)])
def test_by_daylight_and_lamplight(
    color: tuple[float, float, float], name: str | None, tint: tuple[float, float, float]
) -> None:
    seen = pixels(*(a * b for a, b in zip(color, tint, strict=True)))
    shares = light(tint).shares(seen)
    assert shares.sum() == pytest.approx(1, abs=1e-5)
    assert shade_of(shares) == name


def test_in_the_dark_nothing_is_white() -> None:
    black = np.zeros((3, 32, 40), np.float32)
    shares = Light(black, black, ShadeParams()).shares(pixels(0.001, 0.001, 0.001))
    assert np.isfinite(shares).all()
    assert shade_of(shares) == "black"


def test_the_kernel_finds_the_same_light() -> None:
    pytest.importorskip("numba")
    chance = np.random.default_rng(2)
    picture, ground = (chance.random((3, 32, 40)).astype(np.float32) for _ in range(2))
    picture[:, 8:12, 16:20] += 0.5
    picture[1] *= 0.8
    plain = Light(picture, ground, ShadeParams())
    with torch.inference_mode():
        quick = Light(picture, ground, ShadeParams())
    assert quick.balance == pytest.approx(plain.balance, rel=1e-5)
    assert quick.brightest == pytest.approx(plain.brightest, rel=1e-5)
    assert quick.brightest > 0.8


@pytest.mark.parametrize("size", [(2, 9), (9, 2), (1, 1)])
def test_a_picture_smaller_than_what_is_averaged_has_a_light(size: tuple[int, int]) -> None:
    ground = np.full((3, *size), 0.4, np.float32)
    assert Light(2 * ground, ground, ShadeParams()).brightest == pytest.approx(0.8)
