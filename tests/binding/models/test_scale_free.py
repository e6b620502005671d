"""The scale-free model: what it finds in sums, and that its runs go on."""

from __future__ import annotations

import math

import pytest
import torch

import ndtorch

BARS = torch.zeros(2, 10)
BARS[0, [1, 2, 4, 6, 7]] = torch.tensor([1.0, 0.6, 0.7, 0.7, 0.9])
BARS[1, [0, 2, 4, 5, 8]] = torch.tensor([1.0, 0.6, 0.7, 0.7, 0.9])


def two_things(seconds: float, fps: float = 100.0, rates: tuple[float, float] = (0.87, 1.31)) -> torch.Tensor:
    """Sums of two bars that fluctuate at their own rates, `[T, 10]`."""
    t = torch.arange(round(seconds * fps)) / fps
    light = torch.stack([1 + 0.5 * torch.sin(2 * math.pi * rate * t + 2.1 * n) for n, rate in enumerate(rates)], -1)
    return 100 * light @ BARS


READOUTS = ["owners", "sums"]


@pytest.mark.parametrize("readout", READOUTS)
@pytest.mark.parametrize("fps", [12.5, 30.0, 100.0])
def test_two_things_are_two_objects_at_any_rate(readout: str, fps: float) -> None:
    model = ndtorch.load("scale-free", size=(12, 14), fps=fps, readout=readout)
    _, state = model.from_sums(two_things(20, fps))
    found = model.objects(state)
    assert len(found) == 2
    colors = [{name for name in thing.features if name in ("red", "green", "blue")} for thing in found]
    assert sorted(map(sorted, colors)) == [["green"], ["red"]]
    by_color = {next(iter(c)): set(thing.features) for c, thing in zip(colors, found, strict=True)}
    assert "right" in by_color["red"] - by_color["green"]
    assert "left" in by_color["green"] - by_color["red"]


def test_a_constant_scene_has_no_objects() -> None:
    model = ndtorch.load("scale-free", size=(12, 14))
    _, state = model.from_sums(100 * torch.rand(1, 10, generator=torch.Generator().manual_seed(0)).expand(500, 10))
    assert model.verdict(state) == "static"
    assert model.objects(state) == []
    assert not model.second.table(state.second).owners.any()


def test_white_noise_has_no_objects() -> None:
    noise = torch.randn(1500, 10, generator=torch.Generator().manual_seed(0))
    model = ndtorch.load("scale-free", size=(12, 14))
    assert model.objects(model.from_sums(100 + noise)[1]) == []


@pytest.mark.parametrize("readout", READOUTS)
@pytest.mark.parametrize("moving", [False, True])
def test_a_lamp_alone_is_no_object(moving: bool, readout: str) -> None:
    """Light that changes everywhere drives all colors and orientations alike, and the detectors every way alike."""
    generator = torch.Generator().manual_seed(0)
    light = 1 + 0.3 * torch.sin(2 * math.pi * 0.7 * torch.arange(1500) / 100)
    sums = 100 * light[:, None] * (0.9 + 0.2 * torch.rand(10, generator=generator))
    if moving:
        sums[:, :4] = 5 * (light - 1).square()[:, None]
    else:
        sums[:, :4] = 0.0
    sums = sums + 0.1 * torch.randn(1500, 10, generator=generator).abs()
    model = ndtorch.load("scale-free", size=(12, 14), readout=readout)
    assert model.objects(model.from_sums(sums)[1]) == []


@pytest.mark.parametrize("readout", READOUTS)
def test_smooth_noise_on_every_sum_has_no_objects(readout: str) -> None:
    noise, low, rows = torch.randn(1500, 10, generator=torch.Generator().manual_seed(1)), torch.zeros(10), []
    for row in noise:
        low = torch.lerp(low, row, 0.03)
        rows.append(low)
    smooth = torch.stack(rows)
    model = ndtorch.load("scale-free", size=(12, 14), readout=readout)
    assert model.objects(model.from_sums(100 + 10 * smooth / smooth.std())[1]) == []
