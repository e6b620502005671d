"""Stimuli by the formulas of their luminance, and sources of one's own frames."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.scenes import (
    FrameSource,
    counterphase_grating,
    edge,
    flash,
    flicker,
    grating,
    looming_disc,
    make_scene,
    panned_picture,
    plaid,
    random_dots,
    rings,
)
from ndtorch.scenes.patterns import pink_noise
from ndtorch_train.reproduce.sensors import moving_rows

SIZE = (40, 60)
X, Y = np.meshgrid(np.arange(60) - 29.5, 19.5 - np.arange(40))


def sine(direction: float, contrast: float = 0.6) -> Callable[[float], Any]:
    angle = math.radians(direction)
    u = X * math.cos(angle) + Y * math.sin(angle)
    return lambda t: 0.5 * (1 + contrast * np.sin(2 * math.pi * (u / 12 - 3 * t) + math.pi / 6))


TERMS: Any = {"wavelength": 12, "temporal_frequency": 3, "contrast": 0.6, "size": SIZE, "fps": 50}
STEP = X * math.cos(math.radians(30)) + Y * math.sin(math.radians(30))
BEGIN = -(60 * math.cos(math.radians(30)) + 40 * math.sin(math.radians(30))) / 2


@pytest.mark.parametrize(
    ("scene", "luminance"),
    [
        (grating(direction=35, phase=30, **TERMS), sine(35)),
        (
            counterphase_grating(direction=90, **TERMS),
            lambda t: 0.5 * (1 + 0.6 * np.sin(2 * math.pi * Y / 12) * math.cos(6 * math.pi * t)),
        ),
        (
            plaid(direction=10, angle=120, phase=30, **TERMS),
            lambda t: (sine(70)(t) + sine(-50)(t)) / 2,
        ),
        (
            edge("off", speed=100, direction=30, contrast=0.5, size=SIZE, fps=50),
            lambda t: 0.5 * (1 - 0.5 * (2 * np.clip(BEGIN + 100 * t - STEP + 0.5, 0, 1) - 1)),
        ),
        (flash(0.1, 0.2, -0.5, size=SIZE, fps=50), lambda t: 0.25 if 0.1 <= t + 1e-6 < 0.3 else 0.5),
        (flicker(4, 0.5, size=SIZE, fps=50), lambda t: 0.5 + 0.25 * math.sin(8 * math.pi * t)),
        (
            flicker(5, 0.5, profile="square", duty=0.3, size=SIZE, fps=50),
            lambda t: 0.75 if (5 * t + 1e-6) % 1 < 0.3 else 0.25,
        ),
    ],
)
def test_luminance_at_a_place_and_time(scene: FrameSource, luminance: Callable[[float], Any]) -> None:
    frames = torch.cat(list(scene.chunks(7)))[:30]
    assert frames.shape == (30, 3, *SIZE)
    for number in (0, 1, 5, 6, 14, 15, 29):
        want = np.broadcast_to(np.asarray(luminance(number / 50)), SIZE)
        np.testing.assert_allclose(frames[number], np.stack([want] * 3), atol=2e-6)


@pytest.mark.parametrize(("lv", "end"), [(0.02, 1.0), (0.1, 1.2)])
def test_angular_size_of_a_looming_disc(lv: float, end: float) -> None:
    options: Any = {"seconds": 1.0, "fps": 20, "size": (240, 240), "channels": 1, "pixels_per_degree": 2.0}
    looming = looming_disc(lv, end, **options).frames(0, 20)
    for number in (0, 8, 16, 18):
        theta = math.degrees(2 * math.atan(lv / (end - number / 20)))
        area = float((1 - looming[number] / 0.5).sum())
        assert area == pytest.approx(math.pi * theta**2, rel=0.01, abs=1.5)  # of diameter 2 theta pixels
    receding = looming_disc(lv, end, receding=True, **options).frames(0, 20)
    torch.testing.assert_close(receding[1:].flip(0), looming[1:])


@pytest.mark.parametrize(("direction", "across", "up"), [(0, 2, 0), (90, 0, 2), (180, -2, 0)])
def test_pictures_and_dots_move_at_their_speed(direction: float, across: int, up: int) -> None:
    options: Any = {"speed": 50.0, "direction": direction, "fps": 25, "size": SIZE}
    for scene in (panned_picture(**options), random_dots(40, side=2.5, **options)):
        frames = scene.frames(0, 6)
        torch.testing.assert_close(frames[5], frames[0].roll((-5 * up, 5 * across), (-2, -1)), atol=1e-4, rtol=0)
    mixed = random_dots(40, coherence=0.0, lifetime=0.1, **options).frames(0, 6)
    assert float((mixed[5] - mixed[0].roll((-5 * up, 5 * across), (-2, -1))).abs().mean()) > 0.02


def test_a_picture_comes_from_a_file_or_an_array(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (3, 20, 30), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "a.png"), picture[::-1].transpose(1, 2, 0))
    for given in (tmp_path / "a.png", picture):
        frame = panned_picture(given, speed=[0.0, 100.0], fps=100, size=(25, 30)).frames(3, 4)
        np.testing.assert_allclose(frame[0, 0, :, :20], picture / 255, atol=1e-6)
        np.testing.assert_allclose(frame[1, 0, :, :20, 3:], picture[..., :-3] / 255, atol=1e-6)
    with pytest.raises(InputError, match="cannot be read"):
        panned_picture(tmp_path / "b.png")
    # Power falls as 1/f^2: a quarter from one octave to the next, per frequency.
    power = torch.fft.rfft2(pink_noise((256, 256), 1)).abs().square()
    assert float(power[:128, 16:32].mean() / power[:128, 32:64].mean()) == pytest.approx(2.2, abs=0.6)


@pytest.mark.parametrize("position", [0.0, 0.3, -7.75, 1234.5])
def test_a_square_grating_is_the_mean_over_pixels(position: float) -> None:
    fine = 1000
    x = (torch.arange(40 * fine, dtype=torch.float64) + 0.5) / fine
    bright = ((x - position) % 20 < 10).double().reshape(40, fine).mean(-1)
    rows = moving_rows([0.0, 1.5], [position], length=5, width=40).frames(0, 5)[..., 0, 0, :].double()
    torch.testing.assert_close(rows[0, 0, 4], 0.25 + 0.5 * bright, atol=2 / fine, rtol=0)
    torch.testing.assert_close(rows[1, 0, 4, 6:], rows[1, 0, 0, :-6], atol=1e-6, rtol=0)


def test_numbers_broadcast_to_a_batch() -> None:
    both = grating([[10.0], [20.0]], contrast=[0.1, 0.2, 0.3], size=SIZE, channels=1)
    assert both.frames(0, 2).shape == (2, 3, 2, 1, *SIZE)
    one = grating(20.0, contrast=0.2, size=SIZE, channels=1)
    torch.testing.assert_close(both.frames(0, 2)[1, 1], one.frames(0, 2))
    for wrong in ({"wavelength": 0}, {"contrast": "high"}, {"profile": "round"}, {"wavelenght": 3}):
        with pytest.raises(InputError):
            make_scene("grating", **wrong)


@pytest.mark.parametrize("last", [False, True])
def test_frames_of_ones_own(last: bool) -> None:
    frames = torch.randint(0, 256, (10, 3, 8, 9), dtype=torch.uint8)
    mine = frames.movedim(-3, -1) if last else frames
    for given in (mine, mine.numpy(), list(mine), (frame.numpy() for frame in mine)):
        source = FrameSource.from_array(given, fps=20)
        assert (source.size, source.fps) == ((8, 9), 20)
        assert torch.equal(torch.cat(list(source.chunks(4, 2))), frames[2:])
    with pytest.raises(InputError, match="1 or 3 colors"):
        FrameSource.from_array(torch.zeros(5, 7, 7, 7), 20)
    with pytest.raises(InputError, match="one or more"):
        FrameSource.from_array([], 20)


def test_stimuli_by_name_have_options(tmp_path: Path) -> None:
    asked = ["on-edge", str(tmp_path / "a.mkv"), "--seconds", "0.1", "--set", "size=[40,60]", "--set", "contrast=0.5"]
    assert main(["render", *asked]) == 0
    ok, frame = cv2.VideoCapture(str(tmp_path / "a.mkv")).read()
    assert ok
    assert frame.shape == (40, 60, 3)
    assert abs(float(frame.mean()) - 64) < 3


@pytest.mark.parametrize("number", [0, 37, 130, 399])
def test_values_of_the_printed_equation(number: int) -> None:
    frame = rings(seconds=4.0).frames(number, number + 1)[0].numpy()
    t = number / 100
    for row, column in ((0, 0), (49, 50), (50, 61), (12, 83)):
        r = math.hypot(row - 49.5, column - 49.5)
        theta, psi = 2 * math.pi * 0.5 * t, 2 * math.pi * 0.2 * r + 2 * math.pi * 0.5 * t
        want = math.exp(-(r**2) / 1250) * (1 + math.sin(theta)) / 2 * (1 + math.cos(psi)) / 2
        np.testing.assert_allclose(frame[:, row, column], want, atol=1e-6)
