"""Choice of the image scale for motion by the measured displacement."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from ndtorch.vision.camera.params import CameraParams
from ndtorch.vision.camera.scales import best_level, scale_start, scale_step, shift_per_delay
from ndtorch.vision.temporal import smoothing_factor

DT, LOW = 1 / 25, 0.05


def texture(shift: float) -> Tensor:
    """Soft isotropic texture, moved to the right by `shift` pixels, `[3, 64, 96]`."""
    y, x = torch.meshgrid(torch.arange(64.0), torch.arange(96.0) - shift, indexing="ij")
    waves = [(0.21, 0.05), (0.06, 0.24), (-0.16, 0.15), (0.17, 0.17)]
    return sum((torch.sin(a * x + b * y + i) for i, (a, b) in enumerate(waves)), torch.zeros(64, 96)).expand(3, 64, 96)


@pytest.mark.parametrize("speed", [0.25, 0.5, 1.0, 2.0])
def test_displacement_is_measured_and_direction_seen(speed: float) -> None:
    state = scale_start(texture(0))
    rates = smoothing_factor(0.5, DT), smoothing_factor(LOW, DT)
    total = torch.zeros(2)
    for n in range(1, 25):
        moved, level, state = scale_step(texture(speed * n), state, DT, *rates, CameraParams(tau_low=LOW))
        total += moved[int(level)].mean((-1, -2))
    expected = speed * (LOW + DT) / DT
    assert shift_per_delay(state, DT, LOW) == pytest.approx(expected, rel=0.3)
    assert total[0] > 3 * total[1].abs()


def test_levels_are_octaves_of_the_best_shift() -> None:
    shifts = torch.tensor([0.0, 0.2, 1.5, 2.0, 2.5, 4.0, 5.0, 40.0])
    assert best_level(shifts, 1.5).tolist() == [1, 0, 0, 0, 1, 1, 2, 2]


def test_nothing_moved_means_no_shift() -> None:
    state = scale_start(torch.zeros(3, 16, 16))
    _, level, state = scale_step(torch.zeros(3, 16, 16), state, DT, 0.1, 0.5, CameraParams(tau_low=LOW))
    assert shift_per_delay(state, DT, LOW) == 0
    assert level == 1
