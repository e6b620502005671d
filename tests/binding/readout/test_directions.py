"""How many directions are sources."""

from __future__ import annotations

import pytest
import torch

from ndtorch.binding.readout.owners import SumCriteria
from ndtorch.binding.readout.source_count import empty, full
from ndtorch.binding.readout.sums import SumStatistics
from tests.binding.readout.three_lights import MIXING, count, lights


@pytest.mark.parametrize("white", [False, True])
def test_noise_of_a_third_on_every_sum_is_no_object(white: bool) -> None:
    generator = torch.Generator().manual_seed(2)
    noise = torch.randn(1500, 10, generator=generator)
    if not white:
        kernel = torch.exp(-0.5 * (torch.arange(-40, 41) / 12).square())
        noise = torch.nn.functional.conv1d(noise.mT[:, None], kernel[None, None], padding=40)[:, 0].mT
    sums = lights(15)[:, :2] @ MIXING[:2]
    assert count(SumStatistics()(100 * (sums + 0.3 * 0.35 * noise / noise.std()))) == 2


def test_bars_alike_in_color_and_orientation_are_told_apart_by_motion() -> None:
    mixing = MIXING.clone()
    mixing[2] = mixing[1]
    mixing[2, :4] = torch.tensor([0.0, 0.0, 1.0, 0.0])
    assert count(SumStatistics()(100 * lights(15) @ mixing)) == 3


def test_motion_of_a_time_course_of_its_own_is_no_second_thing() -> None:
    # Edges between pixels, and brightness that was another a moment ago, change how much moves, not where to.
    light = lights(15)[:, :1]
    sums = light @ MIXING[:1]
    t = torch.arange(len(light)) / 100
    sums[:, :4] *= 1 + 0.3 * (13 * t).sin()[:, None]
    assert count(SumStatistics()(100 * sums)) == 1


@pytest.mark.parametrize(
    ("faintest", "at_once", "left", "five"),
    [
        (2e-3, 1e-6, 1e-6, True),
        (2e-4, 1e-6, 1e-6, True),
        (9e-5, 1e-6, 1e-6, False),
        (2e-3, 1e-6, 1e-4, False),
        (2e-3, 1e-3, 1e-6, False),
    ],
    ids=[
        "stands out",
        "faint",
        "fainter than anything believed",
        "beside noise with a delay",
        "beside noise without one",
    ],
)
def test_five_of_six_directions_hold_sources_where_the_sixth_holds_next_to_nothing(
    faintest: float, at_once: float, left: float, five: bool
) -> None:
    turned = torch.linalg.qr(torch.randn(6, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(0)))[0]
    delayed = turned @ torch.diag(torch.tensor([left, faintest, 0.02, 0.05, 0.2, 1.0], dtype=torch.float64)) @ turned.mT
    without = delayed + at_once * torch.eye(6, dtype=torch.float64)
    assert full(without[None], delayed[None], SumCriteria()).tolist() == [five]


@pytest.mark.parametrize(
    ("faintest", "noise", "four", "exact"),
    [(2e-4, 1e-9, True, True), (2e-4, 2e-6, True, False), (2e-4, 1e-5, False, False), (9e-5, 1e-9, False, False)],
    ids=["beside nothing", "beside next to nothing", "beside noise", "fainter than anything believed"],
)
def test_a_faint_fourth_source_is_believed_where_two_directions_hold_next_to_nothing(
    faintest: float, noise: float, four: bool, exact: bool
) -> None:
    held = torch.tensor([noise / 2, noise, faintest, 0.05, 0.2, 1.0], dtype=torch.float64)
    turned = torch.linalg.qr(torch.randn(6, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(0)))[0]
    delayed = (turned @ torch.diag(held) @ turned.mT)[None]
    assert [found.tolist() for found in empty(delayed, delayed, SumCriteria())] == [[four], [exact]]
