"""Objects with a place: windows over retinotopic signals."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from ndtorch.binding import ObjectFiles
from ndtorch.binding.models.retinotopic import owner_column
from ndtorch.binding.object_files import ObjectFileState
from ndtorch.binding.objects import features_by_group
from ndtorch.vision import FEATURES

GRID = (16, 16)
DT = 0.05
RIGHT_RED = torch.tensor([0, 1.0, 0, 0, 1.0, 0, 0, 1.0, 0, 0])
LEFT_GREEN = torch.tensor([1.0, 0, 0, 0, 0, 1.0, 0, 0, 1.0, 0])
UP_BLUE = torch.tensor([0, 0, 0, 1.0, 0, 0, 1.0, 0, 0, 1.0])


def wave(steps: int, period: float, phase: float = 0.0) -> Tensor:
    return 0.5 + 0.25 * torch.sin(2 * math.pi * (torch.arange(steps) * DT / period + phase))


def blob(
    features: Tensor,
    light: Tensor,
    start: tuple[float, float],
    velocity: tuple[float, float],
    grid: tuple[int, int] = GRID,
    wrap: bool = True,
) -> Tensor:
    """Signals `[T, R, C, 10]` of an object one field wide; motion grows with the square of its brightness."""
    time = torch.arange(len(light)) * DT
    total = []
    for axis in (0, 1):
        center = start[axis] + velocity[axis] * time
        away = torch.arange(grid[axis]) - center[:, None]
        if wrap:
            away = (away + grid[axis] / 2) % grid[axis] - grid[axis] / 2
        total.append(torch.exp(-away.square() / 0.8))
    share = total[0][:, :, None] * total[1][:, None, :]
    strength = torch.cat([light[:, None].square().expand(-1, 4), light[:, None].expand(-1, 6)], -1)
    return share[..., None] * (strength * features)[:, None, None, :]


def windows() -> ObjectFiles:
    return ObjectFiles(GRID, 30.0, DT)


def features_of(module: ObjectFiles, state: ObjectFileState) -> list[set[str]]:
    there = module.confirmed(state)
    rows = features_by_group(owner_column(state.covariance, torch.zeros(10, 10))[1])[there]
    return [{name for name, value in zip(FEATURES, row.tolist(), strict=True) if value > 0} for row in rows]


def test_one_object_its_features_place_and_velocity() -> None:
    module = windows()
    counts, state = module(blob(RIGHT_RED, wave(200, 1.1), (4.0, 3.0), (0.0, 1.5)))
    assert counts[:10].sum() == 0
    assert counts[30:].tolist() == [1] * 170
    assert features_of(module, state) == [{"right", "0°", "red"}]
    (k,) = module.confirmed(state).nonzero().flatten().tolist()
    place, velocity = (part[k].tolist() for part in module.places(state))
    # After 199 steps at column 3 + 1.5 * 9.95 = 17.925, which is 1.925 around the torus; fields are 30 pixels.
    assert tuple(place) == pytest.approx(((1.925 + 0.5) * 30, 4.5 * 30), abs=10)
    assert tuple(velocity) == pytest.approx((45.0, 0.0), abs=6)
    assert float(state.age[k]) == pytest.approx(10.0, abs=0.3)


def test_two_equal_objects_are_two() -> None:
    one = blob(RIGHT_RED, wave(300, 1.1), (4.0, 3.0), (0.0, 1.5))
    other = blob(RIGHT_RED, wave(300, 0.7), (4.0, 7.0), (0.0, 1.5))
    module = windows()
    counts, state = module(one + other)
    assert counts[-1] == 2
    assert features_of(module, state) == [{"right", "0°", "red"}] * 2


def test_objects_that_cross_keep_their_windows() -> None:
    light = wave(200, 1.1), wave(200, 0.8, 0.3)
    scene = blob(RIGHT_RED, light[0], (8.0, 3.0), (0.0, 1.5)) + blob(UP_BLUE, light[1], (13.0, 8.0), (-1.5, 0.0))
    module = windows()
    counts, state = module(scene[:50])
    before = (module.confirmed(state).tolist(), features_of(module, state))
    counts, state = module(scene[50:160], state)
    assert counts.tolist() == [2] * 110
    assert (module.confirmed(state).tolist(), features_of(module, state)) == before


def test_both_ends_of_a_long_object_are_one_object_in_the_middle() -> None:
    light = wave(160, 1.3)
    long = sum(blob(RIGHT_RED, light, (6.0 + step, 3.0), (0.0, 1.5)) for step in (-1.2, 0.0, 1.2))
    other = blob(LEFT_GREEN, wave(160, 0.9, 0.3), (13.0, 9.0), (0.0, -1.5))
    module = windows()
    counts, state = module(long + other)
    assert int(counts[-60:].max()) == int(counts[-60:].min()) == 2
    rows = state.place[module.confirmed(state)][:, 0]
    assert (rows - 6.0).abs().min() < 0.6


def test_a_faint_object_is_seen_beside_a_bright_one() -> None:
    bright = blob(RIGHT_RED, wave(160, 1.1), (4.0, 3.0), (0.0, 1.5))
    faint = blob(LEFT_GREEN, 0.15 * wave(160, 0.7), (11.0, 9.0), (0.0, -1.5))
    module = windows()
    counts, state = module(bright + faint)
    assert counts[-60:].tolist() == [2] * 60
    assert features_of(module, state) == [{"right", "0°", "red"}, {"left", "60°", "green"}]


def test_an_object_that_leaves_is_given_up() -> None:
    scene = blob(RIGHT_RED, wave(260, 1.1), (4.0, 8.0), (0.0, 2.0), wrap=False)
    still = blob(UP_BLUE, wave(260, 0.9), (12.0, 4.0), (0.0, 0.2), wrap=False)
    module = ObjectFiles(GRID, 30.0, DT, border="reflect")
    counts, state = module(scene + still)
    assert counts[60] == 2
    assert features_of(module, state) == [{"up", "120°", "blue"}]


@pytest.mark.parametrize("seed", range(5))
def test_noise_is_no_object(seed: int) -> None:
    noise = torch.rand(200, *GRID, 10, generator=torch.Generator().manual_seed(seed))
    counts, _ = windows()(noise)
    assert counts.max() == 0


def two() -> Tensor:
    return blob(RIGHT_RED, wave(80, 1.1), (4.0, 3.0), (0.0, 1.5)) + blob(
        LEFT_GREEN, wave(80, 0.7), (9.0, 9.0), (0.5, -1.5)
    )


@settings(max_examples=8, deadline=None)
@given(st.floats(1e-3, 1e3), st.integers(0, 15), st.integers(0, 15))
def test_brightness_and_place_do_not_matter(gain: float, down: int, right: int) -> None:
    module = windows()
    # Motion is a product of two brightnesses.
    gains = torch.tensor([gain**2] * 4 + [gain] * 6)
    counts, state = module((two() * gains).roll((down, right), (1, 2)))
    assert counts[-1] == 2
    assert set(map(frozenset, features_of(module, state))) == {
        frozenset({"right", "0°", "red"}),
        frozenset({"left", "60°", "green"}),
    }
