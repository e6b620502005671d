"""Moving bars and their light: area, places, wrapping, shadows, distance, batches, the same frames in any chunk."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.scenes import (
    SCENES,
    Bar,
    BarScene,
    Distance,
    Fluctuation,
    RandomShadow,
    SineShadow,
    hsl_color,
    make_scene,
    three_bars,
    two_bars,
)

WHITE = (1.0, 1.0, 1.0)
RED, GREEN = (0.75, 0.1, 0.1), (0.1, 0.75, 0.1)


def scene(*bars: Bar, seconds: float = 1.0, size: tuple[int, int] = (80, 90), **options: object) -> BarScene:
    return BarScene(list(bars), seconds, size=size, **options)  # type: ignore[arg-type]


@settings(max_examples=30, deadline=None)
@given(
    direction=st.floats(-360, 360),
    tilt=st.floats(-360, 360),
    x=st.floats(-200, 200),
    y=st.floats(-200, 200),
    length=st.floats(2, 50),
    width=st.floats(2, 50),
)
def test_any_bar_has_its_area_and_stays_in_range(
    direction: float, tilt: float, x: float, y: float, length: float, width: float
) -> None:
    frames = scene(Bar(WHITE, direction, (x, y), tilt, length=length, width=width)).frames(0, 3)
    assert frames.min() >= 0
    assert frames.max() <= 1
    area = frames[:, 0].double().sum((-2, -1))
    torch.testing.assert_close(area, torch.full_like(area, length * width), rtol=0.02, atol=0.3)


def test_matches_an_independent_drawing_of_the_equations() -> None:
    bar = Bar((0.5, 0.25, 1.0), -30, (41.3, 36.8), length=30, width=9)
    other = Bar(GREEN, 200, (48.0, 40.0), orientation=75, length=26, width=7)
    got = scene(bar, other, fluctuation=SineShadow()).frames(0, 40)[37]

    rows, columns = np.mgrid[:80, :90].astype(float)
    want = np.zeros((3, 80, 90))
    for b in (bar, other):
        angle, tilt = np.radians(b.direction), np.radians(b.tilt)
        x = columns - (b.start[0] + 50 * 0.37 * np.cos(angle))
        up = -(rows - (b.start[1] - 50 * 0.37 * np.sin(angle)))
        across, along = x * np.cos(tilt) + up * np.sin(tilt), -x * np.sin(tilt) + up * np.cos(tilt)
        cover = np.clip(b.width / 2 + 0.5 - np.abs(across), 0, 1)
        cover = cover * np.clip(b.length / 2 + 0.5 - np.abs(along), 0, 1)
        want = want * (1 - cover) + cover * np.array(b.color)[:, None, None]
    want *= 0.5 + 0.25 * np.sin(2 * np.pi * columns / 50)
    np.testing.assert_allclose(got.numpy(), want, atol=2e-6)


def test_wraps_around_every_edge() -> None:
    bar = Bar(RED, 45, (44.3, 39.6), length=30)
    inside = scene(bar).frames(0, 1)
    for shift in ((45, 0), (0, 40), (-30, 25), (90, 80)):
        moved = scene(Bar(RED, 45, (44.3 + shift[0], 39.6 + shift[1]), length=30)).frames(0, 1)
        torch.testing.assert_close(moved, inside.roll((shift[1], shift[0]), (-2, -1)), rtol=0, atol=1e-5)


@pytest.mark.parametrize("kind", [Fluctuation(), SineShadow(), RandomShadow(5), Distance(phase=[0, 70])])
def test_frames_are_the_same_bits_in_whatever_chunk(kind: Fluctuation) -> None:
    source = scene(Bar(RED, -30, (20, 30)), Bar(GREEN, 210, (70, 50)), fluctuation=kind, seconds=0.77)
    whole = torch.cat(list(source.chunks(source.length)))
    assert whole.shape == (77, 3, 80, 90)
    for frames in (1, 7, 32):
        assert torch.equal(torch.cat(list(source.chunks(frames))), whole)
    assert torch.equal(torch.cat(list(source.chunks(7, start=50))), whole[50:])
    assert list(source.chunks(7, start=77)) == []


@pytest.mark.parametrize("kind", [Fluctuation(), SineShadow(), Distance(phase=[[0, 30], [10, 90], [5, 200]])])
def test_a_batch_equals_its_scenes(kind: Fluctuation) -> None:
    scenes = [[Bar(RED, 20 * n, (20 + n, 30), length=40 + n), Bar(GREEN, 210 - n, (70, 50 - n))] for n in range(3)]
    batch = torch.cat(list(BarScene(scenes, 0.2, kind, (80, 90)).chunks(6)), dim=1)
    assert batch.shape == (3, 20, 3, 80, 90)
    for n, bars in enumerate(scenes):
        own = Distance(phase=kind.phase[n]) if isinstance(kind, Distance) else kind
        single = torch.cat(list(BarScene(bars, 0.2, own, (80, 90)).chunks(6)))
        assert torch.equal(batch[n], single)


def test_sine_shadow_is_the_published_pattern() -> None:
    light = SineShadow().light((500, 500))
    assert light.shape == (1, 1, 500)
    assert light.min().item() == pytest.approx(0.25, abs=1e-3)
    assert light.max().item() == pytest.approx(0.75, abs=1e-3)
    assert light[0, 0, 50].item() == pytest.approx(0.5)
    assert light[0, 0, 10].item() == pytest.approx(0.5 + 0.25 * math.sin(0.4 * math.pi))
    assert SineShadow(phase=90).light((8, 8))[0, 0, 0].item() == pytest.approx(0.75)


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


def test_scenes_by_name() -> None:
    for name in SCENES:
        scene = make_scene(name)
        assert scene.name == name
        assert SCENES[name].description
        assert next(iter(scene.chunks(2))).shape[-4:-2] == (2, 3)
    still = make_scene("two-bars-still-light")
    assert isinstance(still, BarScene)
    assert still.length == 1900
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
