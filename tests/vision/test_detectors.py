"""Detectors against the properties that were published of the cells."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from ndtorch.vision import BarlowLevick, DirectionalND, LoomingDetector, SmallTargetDetector


def slits(*times: int) -> Tensor:
    """Slits of light that appear at neighboring columns in these frames and stay; 0 for never."""
    film = torch.zeros(60, 1, 3, 12)
    for column, time in enumerate(times):
        if time:
            film[time:, ..., 5 + column] = 1.0
    return film


@pytest.mark.parametrize("interval", [5, 10])
def test_two_slits_in_the_null_direction_are_vetoed(interval: int) -> None:
    """Barlow and Levick's experiment: in the preferred sequence the responses add up, in the other one is missing."""

    def right(film: Tensor) -> float:
        return float(BarlowLevick(border="reflect")(film)[0][:, 1].sum())

    first, second = right(slits(10)), right(slits(0, 10))
    forward, backward = right(slits(10, 10 + interval)), right(slits(10 + interval, 10))
    assert second == pytest.approx(first, rel=1e-4)
    assert backward < 1.1 * second
    assert forward > 1.3 * backward
    out = BarlowLevick(border="reflect")(slits(10, 10 + interval))[0].sum((0, 2, 3))
    mirrored = BarlowLevick(border="reflect")(slits(10, 10 + interval).flip(-1))[0].sum((0, 2, 3))
    torch.testing.assert_close(mirrored[:2], out[:2].flip(0))


@pytest.mark.parametrize("speed", [5.0, 20.0, 80.0])
def test_an_edge_excites_one_direction(speed: float) -> None:
    edge = torch.sigmoid((speed * torch.arange(100)[:, None] * 0.01 - torch.arange(40.0) + 4) * 3)
    out, _ = BarlowLevick(border="reflect")(edge[:, None, None].expand(-1, 1, 4, -1))
    left, right, down, up = out[20:].sum((0, 2, 3))  # after it began to move
    assert right > 5 * max(left, down, up)


def passing(height: int, width: int, speed: float, delay: float = 0.025, dark: bool = True) -> float:
    """Largest response to a target that moves at a speed in pixels a second, 500 frames a second."""
    t, x = torch.arange(0, 40 / speed, 0.002), torch.arange(60.0)
    back, front = ((x - (end + speed * t)[:, None] + 0.5).clamp(0, 1) for end in (5, 5 + width))
    rows = ((torch.arange(21) - 10).abs() < height / 2).float()
    film = (back - front)[:, None, None] * rows[:, None]
    return float(SmallTargetDetector(0.002, tau_delay=delay)(1 - film if dark else film)[0].max())


def test_small_dark_targets_are_preferred() -> None:
    small = passing(3, 2, 80)
    assert passing(7, 2, 80) < 0.5 * small
    assert passing(21, 2, 80) < 0.02 * small  # a long bar
    assert passing(3, 12, 80) < 0.05 * small  # a wide one
    assert passing(3, 2, 80, dark=False) < 0.1 * small


def test_small_targets_have_an_optimal_speed() -> None:
    """It is lower with a longer delay."""
    speeds = (10.0, 40.0, 160.0, 320.0, 960.0)
    usual, slow = ([passing(3, 2, speed, delay) for speed in speeds] for delay in (0.01, 0.06))
    assert max(usual[0], usual[-1]) < 0.2 * max(usual)
    assert usual.index(max(usual)) > slow.index(max(slow))


def disc(ratio: float) -> tuple[Tensor, Tensor]:
    """Seconds before collision, and a dark disc that approaches with l / v = ratio, 200 frames a second."""
    time = torch.arange(ratio / math.tan(math.radians(3)), 0.005, -0.005)
    grid = torch.arange(101.0) - 50
    radius = ratio / time / math.tan(math.radians(1))
    return time, torch.sigmoid((torch.hypot(grid, grid[:, None]) - radius[:, None, None]) * 2).unsqueeze(1)


def test_looming_peaks_before_collision_in_proportion_to_size_over_speed() -> None:
    ratios, peaks = torch.tensor([0.02, 0.04, 0.06, 0.08]), []
    for ratio in ratios.tolist():
        time, film = disc(ratio)
        peaks.append(time[LoomingDetector((101, 101), 0.005)(film)[0].argmax()])
    line = torch.stack([ratios, torch.stack(peaks)])
    assert torch.corrcoef(line)[0, 1] > 0.999
    slope = (peaks[-1] - peaks[0]) / (ratios[-1] - ratios[0])
    assert slope == pytest.approx(4.7, rel=0.15)


def test_nothing_but_looming_is_answered() -> None:
    detector, film = LoomingDetector((101, 101), 0.005), disc(0.04)[1]
    looming = detector(film)[0].max()
    x, t = torch.arange(101.0) - 50, torch.arange(100) * 0.005
    place = x - (100 * t - 25)[:, None]
    others = {
        "receding": film.flip(0),
        "passing": torch.sigmoid((torch.hypot(place[:, None], x[:, None]) - 12) * 2).unsqueeze(1),
        "grating": (0.5 + 0.5 * torch.sin(place * 0.3))[:, None, None].expand(-1, 1, 101, -1),
        "flicker": (0.5 + 0.5 * torch.sin(40 * t))[:, None, None, None].expand(-1, 1, 101, 101),
    }
    for name, other in others.items():
        assert detector(other)[0].max() < 0.02 * looming, name


@pytest.mark.parametrize("step", [-2.0, -0.5, 0.5, 2.0])
def test_direction_from_non_directional_signals_at_a_third_of_the_rate(step: float) -> None:
    """By the sign of the mean."""
    rows = torch.sin(0.2 * (torch.arange(63.0) - step * torch.arange(60.0)[:, None]))[:, None, None]
    out, _ = DirectionalND(3)(rows)
    assert out[3:].mean() * step > 0
