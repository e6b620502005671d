"""What every public function keeps, whatever it is given: sums, shares, limits, and the same answer in other units."""

from __future__ import annotations

import inspect
import math
import pickle
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor, nn

from ndtorch import binding, navigation, vision
from ndtorch.binding.models.published import PublishedConfig
from ndtorch.errors import InputError
from tests.properties import DT, LONG, PUBLIC, QUICK, RIG, SIZE, same_leaves
from tests.test_properties import PARTS


def numbers(seed: int, *shape: int) -> Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def close(got: Tensor, wanted: Tensor | float) -> None:
    wanted = torch.as_tensor(wanted, dtype=got.dtype)
    torch.testing.assert_close(got, wanted.expand_as(got), rtol=1e-9, atol=1e-9)


def a_low_pass_stays_between(seed: int, n: int) -> None:
    x, low = numbers(seed, 2, n)
    out = vision.low_pass_step(x, low, float(numbers(seed + 1, 1)))
    assert bool(((out >= torch.minimum(x, low)) & (out <= torch.maximum(x, low))).all())


def nothing_moves_between_equal_rows(seed: int, n: int) -> None:
    x, later = numbers(seed, 2, 3, 1, 1, n + 2)
    close(vision.row_shift(x, x), 0.0)
    shifts = vision.row_shift(x, later)
    assert shifts.shape == (3,)
    close(vision.row_shift(x[1], later[1]), shifts[1])
    close(vision.row_shift(5 * x, 5 * later), shifts)


def the_largest_magnitude_has_no_place(seed: int, n: int) -> None:
    x = numbers(seed, 2, 1, n, n) - 0.5
    close(vision.spatial_maximum(x), x.abs().flatten(-2).max(-1).values)
    close(vision.spatial_maximum(-x.roll(1, -1)), vision.spatial_maximum(x))


def a_response_is_the_same_in_chunks(seed: int, n: int) -> None:
    x, sensor = numbers(seed, n + 2, 1, 1, 9), vision.NDMin().double()
    close(vision.speed_response(sensor, x.split(2), 1), vision.speed_response(sensor, [x], 1))
    with pytest.raises(InputError):
        vision.speed_response(sensor, [x], len(x))


def positive(seed: int, n: int, scale: float = 1.0) -> Tensor:
    """Weights of three networks."""
    return scale * numbers(seed, 3, n, n) * (1 - torch.eye(n, dtype=torch.float64))


def objects_have_one_owner_each(seed: int, n: int) -> None:
    weights = positive(seed, 10, 2.0) * (numbers(seed + 1, 3, 10, 10) > 0.5)
    table = binding.object_table(weights)
    close(binding.object_table(weights[1]).rows, table.rows[1])
    things = binding.bound_objects(binding.object_table(weights[1]))
    assert len(things) == int(table.owners[1].sum())
    assert [thing.index for thing in things] == table.owners[1].nonzero().flatten().tolist()
    for thing in things:
        assert all(math.isfinite(value) and value > 0 for value in thing.features.values())
        assert binding.describe(thing).strip()
        assert "\n" not in binding.describe(thing)


def a_state_comes_back_from_its_file(seed: int, n: int) -> None:
    model = binding.PublishedModel(PublishedConfig(size=SIZE, fps=100.0))
    _, state = model(numbers(seed, n, 3, *SIZE).float())
    with tempfile.TemporaryDirectory() as folder:
        binding.save_state(state, Path(folder) / "state", {"a": str(n)})
        kept, about = binding.load_state(Path(folder) / "state", model)
    assert about == {"a": str(n)}
    same_leaves(kept, state)
    same_leaves(binding.to_device(state, "cpu"), state)


def controllers_go_by_name(seed: int, n: int) -> None:
    names = navigation.controller_names()
    assert len(set(names)) == len(names)
    name = names[n % len(names)]
    assert navigation.make_controller(name, RIG, DT).name == name
    with pytest.raises(InputError):
        navigation.make_controller(name + "x", RIG, DT)


def strips_are_cut_out(seed: int, n: int) -> None:
    frames, field = numbers(seed, 2, 3, RIG.height, RIG.width), navigation.Rect(n, n + 5, 2 * n, 2 * n + 7)
    strips = navigation.cut_strips(frames, field, RIG, 3)
    assert torch.equal(strips.field, frames[..., n : n + 5, 2 * n : 2 * n + 7])
    assert strips.row.shape[-2:] == (3, RIG.width)
    assert torch.equal(navigation.cut_strips(frames[1], field, RIG, 3).row, strips.row[1])


def an_avoider_stays_within_its_speeds_and_goes_on_where_it_was(seed: int, count: int) -> None:
    chance = np.random.default_rng(seed)
    frames = chance.integers(0, 256, (count + 2, 2, RIG.height, RIG.width, 3), dtype=np.uint8)
    one, other = navigation.SaccadeController(RIG, DT), navigation.SaccadeController(RIG, DT)
    state = again = None
    for left, right in frames:
        (speed, curvature), state = one(left, right, state)
        resumed, again = other(left, right, None if again is None else pickle.loads(pickle.dumps(again)))
        assert resumed == (speed, curvature)
        assert 0 <= speed <= 1
        assert np.isfinite(curvature)


FUNCTIONS: dict[str, Callable[[int, int], None]] = {
    "SaccadeController": an_avoider_stays_within_its_speeds_and_goes_on_where_it_was,
    "low_pass_step": a_low_pass_stays_between,
    "row_shift": nothing_moves_between_equal_rows,
    "spatial_maximum": the_largest_magnitude_has_no_place,
    "speed_response": a_response_is_the_same_in_chunks,
    "object_table": objects_have_one_owner_each,
    "bound_objects": objects_have_one_owner_each,
    "describe": objects_have_one_owner_each,
    "save_state": a_state_comes_back_from_its_file,
    "load_state": a_state_comes_back_from_its_file,
    "to_device": a_state_comes_back_from_its_file,
    "controller_names": controllers_go_by_name,
    "make_controller": controllers_go_by_name,
    "cut_strips": strips_are_cut_out,
}


ELSEWHERE = """
    alternation dog_spectrum field_weights judge_speed_curve learning_rule limit_spectral_radius load_map save_map
    separated smoothing_factor solutions spectral_radius train_first_stage weight_change
"""
"""Functions with tests of their own."""


def test_nothing_public_is_left_out() -> None:
    """A new module needs its `Part`, a new function its property."""
    public = {name: getattr(module, name) for module in PUBLIC for name in module.__all__}
    modules = {name for name, thing in public.items() if inspect.isclass(thing) and issubclass(thing, nn.Module)}
    # A model is tested as each of its kinds, a sequence in tests/vision/test_modules.py.
    assert modules - set(PARTS) - set(FUNCTIONS) == {"BindingModel", "Sequential"}
    assert {name for name, thing in public.items() if inspect.isfunction(thing)} - set(FUNCTIONS) == set(
        ELSEWHERE.split()
    )


SEEDS, SIZES = st.integers(0, 2**31), st.integers(2, 6)


@pytest.mark.parametrize("about", sorted(set(FUNCTIONS.values()), key=str))
@QUICK
@given(seed=SEEDS, n=SIZES)
def test_functions(about: Callable[[int, int], None], seed: int, n: int) -> None:
    about(seed, n)


@pytest.mark.long
@pytest.mark.parametrize("about", sorted(set(FUNCTIONS.values()), key=str))
@LONG
@given(seed=SEEDS, n=SIZES)
def test_functions_for_many_inputs(about: Callable[[int, int], None], seed: int, n: int) -> None:
    about(seed, n)
