"""The stimuli of the papers: the phase between the bars, distances between them, names and options."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from ndtorch.scenes import (
    SCENES,
    BarScene,
    Fluctuation,
    equal_bars,
    hsl_color,
    make_scene,
    scene_names,
    three_bars,
    two_bars,
)

PURE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
SHADOW_HZ = 50 * math.cos(math.pi / 6) / 50


RATE = 20
"""Frames a second that are looked at, of 100: light changes with 1.25 Hz at most."""


def sums(scene: BarScene, seconds: float) -> np.ndarray:
    """Sum of every plane over time."""
    frames = range(0, round(100 * seconds), 100 // RATE)
    rows = [scene.frames(n, n + 1)[..., 0, :, :, :].sum((-2, -1)) for n in frames]
    return torch.stack(rows, -2).double().numpy()


def lead(signals: np.ndarray, hertz: float) -> float:
    """Phase of the second plane minus that of the first, in degrees, by fitting sinusoids."""
    t = np.arange(len(signals)) / RATE
    basis = np.stack([np.sin(2 * np.pi * hertz * t), np.cos(2 * np.pi * hertz * t), np.ones_like(t)], 1)
    fit = np.linalg.lstsq(basis, signals, rcond=None)[0]
    phases = np.degrees(np.arctan2(fit[1], fit[0]))
    return float((phases[1] - phases[0]) % 360)


def apart(got: float, want: float) -> float:
    return abs((got - want + 180) % 360 - 180)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (250.0, -85.0)])
def test_phase_is_the_lead_of_green_over_red(shift: tuple[float, float]) -> None:
    phases = [0.0, 60.0, 145.0, 300.0]
    signals = sums(two_bars(phase=phases, colors=PURE, shift=shift), 3 / SHADOW_HZ)
    for n, phase in enumerate(phases):
        assert apart(lead(signals[n, :, :2], SHADOW_HZ), phase) < 2


def test_blue_offset_moves_only_the_blue_bar_through_the_shadow() -> None:
    pair = three_bars(blue_offset=[0.0, 12.5], colors=(*PURE, (0.0, 0.0, 1.0)))
    signals = sums(pair, 3.0)
    np.testing.assert_array_equal(signals[0, :, :2], signals[1, :, :2])
    # The blue bar moves left: further right means earlier in its cycle of 50 px.
    assert apart(lead(signals[:, :, 2].T, 1.0), -90) < 2


@pytest.mark.parametrize("phase", [60.0, 359.0])
def test_red_and_green_start_in_their_corners_and_never_touch(phase: float) -> None:
    scene = two_bars(phase=phase, colors=PURE)
    red, green = scene.bars
    assert red.start == (50, 40)  # type: ignore[union-attr]
    assert 425 <= green.start[0] <= 475  # type: ignore[union-attr]
    for n in range(300, scene.length, 8):  # in between a bar moves by a third of its width
        frame = scene.frames(n, n + 1)[0]
        assert frame[0].max() > 0
        assert (frame[0] * frame[1]).max() == 0


def test_blue_stays_clear_of_the_others_for_the_whole_run() -> None:
    for phase in (0.0, 180.0, 350.0):
        scene = three_bars(phase=phase, blue_offset=[0.0, 25.0, 49.0], colors=(*PURE, (0.0, 0.0, 1.0)))
        for n in range(0, scene.length, 20):  # a bar moves by 10 pixels, and is 12 wide
            red, green, blue = (scene.frames(n, n + 1) > 0).unbind(-3)
            assert not (blue & (red | green)).any()


@pytest.mark.parametrize("kind", ["shadow", "distance"])
def test_equal_bars_differ_in_their_fluctuation_alone(kind: str) -> None:
    scene = equal_bars(fluctuation=kind)
    first, second, third = scene.bars
    for bar in (second, third):
        assert (bar.color, bar.direction, bar.tilt, bar.speed) == (  # type: ignore[union-attr]
            first.color,  # type: ignore[union-attr]
            first.direction,  # type: ignore[union-attr]
            first.tilt,  # type: ignore[union-attr]
            first.speed,  # type: ignore[union-attr]
        )
    total = sums(scene, 19.0)[:, 1]
    spectrum = np.abs(np.fft.rfft(total - total.mean()))
    peaks = set(np.argsort(spectrum)[-8:])
    expected = [0.866 * 50 / p for p in (125 / 3, 50, 62.5)] if kind == "shadow" else [0.8, 1.0, 1.25]
    for hertz in expected:
        assert peaks & {math.floor(hertz * 19), math.ceil(hertz * 19)}


def test_scenes_by_name() -> None:
    assert scene_names() == list(SCENES)
    for name in scene_names():
        scene = make_scene(name)
        assert scene.name == name
        assert scene.length == (75 if name == "common-fate" else 1900)
        assert SCENES[name].description
        assert next(iter(scene.chunks(2))).shape[-4:-2] == (2, 3)
    still = make_scene("two-bars-still-light")
    assert isinstance(still, BarScene)
    assert isinstance(still.fluctuation, Fluctuation)
    totals = torch.stack([still.frames(n, n + 1).sum() for n in range(0, 300, 7)])
    torch.testing.assert_close(totals, totals[0].expand_as(totals), rtol=2e-3, atol=0)
    assert make_scene("two-bars-distance", fluctuation="none", seconds=1.0).length == 100


def test_hsl_agrees_with_the_standard_library() -> None:
    colorsys = pytest.importorskip("colorsys")
    hue, saturation, lightness = torch.meshgrid(
        torch.arange(-360.0, 720.0, 35.0), torch.linspace(0, 1, 4), torch.linspace(0, 1, 5), indexing="ij"
    )
    got = hsl_color(hue, saturation, lightness).flatten(0, -2)
    flat = zip(hue.flatten().tolist(), saturation.flatten().tolist(), lightness.flatten().tolist(), strict=True)
    want = torch.tensor([colorsys.hls_to_rgb(h / 360 % 1, x, s) for h, s, x in flat])
    torch.testing.assert_close(got, want, atol=1e-5, rtol=0)
    assert hsl_color(120, 1, 0.5).tolist() == [0, 1, 0]
