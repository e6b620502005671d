"""Properties that hold of everything public, for inputs drawn by chance. What is public and not here makes it fail."""

from __future__ import annotations

import dataclasses
import inspect
import math
import pickle
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pydantic
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from ndtorch import binding, navigation, vision
from ndtorch.binding.models.published import PublishedConfig
from ndtorch.binding.models.retinotopic import RetinotopicConfig
from ndtorch.binding.models.scale_free import ScaleFreeConfig
from ndtorch.binding.models.video import VideoConfig
from ndtorch.errors import InputError
from ndtorch.tree import leaves, mapped
from tests.properties import KINDS, Part, check, cut, samples, trial
from tests.strategies import chunkings

PUBLIC: tuple[ModuleType, ...] = (vision, binding, navigation)
SIZE = (16, 20)
RIG = navigation.StereoRig(width=160, height=120, focal=107.5)
DT = 1 / 30
Draw = Callable[..., Tensor]


def pictures(draw: Draw) -> tuple[Tensor, ...]:
    return (draw(3, *SIZE),)


def rows(draw: Draw) -> tuple[Tensor, ...]:
    return (draw(1, 1, 24),)


def signals(draw: Draw) -> tuple[Tensor, ...]:
    return (draw(10),)


def eyes(draw: Draw) -> tuple[Tensor, ...]:
    return draw(1, RIG.height, RIG.width), draw(1, RIG.height, RIG.width)


def pose_of(draw: Draw) -> navigation.Pose:
    return navigation.Pose(draw(), draw(), 6.0 * draw())


def seen(draw: Draw) -> tuple[Any, ...]:
    left, angle = 0.2 + 2 * draw(4), draw(4) - 0.5
    right, x = angle - 0.1, left * torch.cos(angle)
    return navigation.Ranges(left, angle, right, x, left * torch.sin(angle), draw(4) > 0.3), pose_of(draw)


def attended(draw: Draw) -> tuple[Tensor, ...]:
    return draw(3, *SIZE), draw(10, *SIZE), draw(10), draw(10)


def table(trials: int) -> dict[str, Any]:
    return {"table": binding.object_table(torch.full((10, 10), 0.5, dtype=torch.float64).fill_diagonal_(0.0))}


def steered(name: str) -> Part:
    """A controller, as a navigator asks it, with a map, a list and a tracker where there are."""
    return Part(lambda: navigation.Navigator(RIG, DT, controller=name), eyes, limit=1e-6, double=False)


PARTS: dict[str, Part] = {
    "LowPass": Part(lambda: vision.LowPass(0.1, DT), pictures),
    "HighPass": Part(lambda: vision.HighPass(0.1, DT), pictures),
    "RecentMax": Part(lambda: vision.RecentMax(0.1, DT), signals),
    "NDMin": Part(lambda: vision.NDMin(), rows),
    "NDMinus": Part(lambda: vision.NDMinus(), rows),
    "NDS": Part(lambda: vision.NDS(tau_low=0.1), rows),
    "ChahlSrinivasan": Part(lambda: vision.ChahlSrinivasan(), rows),
    "Resample": Part(lambda: vision.Resample(DT, 0.01), signals),
    "HassensteinReichardt": Part(lambda: vision.HassensteinReichardt(), pictures),
    "OrientedDoG": Part(lambda: vision.OrientedDoG(SIZE), pictures, state=False),
    "VisualFeatures": Part(lambda: vision.VisualFeatures(SIZE), pictures),
    "LocalFeatures": Part(lambda: vision.LocalFeatures(vision.VisualFeatures(SIZE), 4), pictures),
    "CameraFrontEnd": Part(
        lambda: vision.CameraFrontEnd((40, 48), 30.0), lambda draw: (draw(3, 40, 48),), batched=False
    ),
    "CoherentMotion": Part(
        lambda: vision.CoherentMotion((40, 48), DT, vision.CoherentParams(kept=0.3, fastest=9.0)),
        lambda draw: (draw(3, 40, 48),),
    ),
    "BindingInputs": Part(lambda: binding.BindingInputs(), signals),
    "InhibitoryNetwork": Part(lambda: binding.InhibitoryNetwork(settle=0.02), signals),
    "Windows": Part(lambda: binding.Windows((4, 4), 4.0), lambda draw: (draw(4, 4, 10),)),
    "Attention": Part(lambda: binding.Attention(DT), attended, fixed=table),
    "PublishedModel": Part(
        lambda: binding.PublishedModel(PublishedConfig(size=SIZE, fps=100.0)), pictures, times=frozenset({"time"})
    ),
    "ScaleFreeModel": Part(
        lambda: binding.ScaleFreeModel(ScaleFreeConfig(size=SIZE, fps=100.0)), pictures, times=frozenset({"time"})
    ),
    "RetinotopicModel": Part(
        lambda: binding.RetinotopicModel(RetinotopicConfig(size=(24, 24), fps=100.0)),
        lambda draw: (draw(3, 24, 24),),
        times=frozenset({"time"}),
    ),
    "VideoModel": Part(
        lambda: binding.VideoModel(VideoConfig(size=(40, 48), fps=30.0)),
        lambda draw: (draw(3, 40, 48),),
        batched=False,
    ),
    "AlphaBetaTracker": Part(lambda: navigation.AlphaBetaTracker(DT), seen, final=True),
    "DeadReckoning": Part(lambda: navigation.DeadReckoning(DT), lambda draw: (draw() - 0.3, draw() - 0.5)),
    "GridMap": Part(lambda: navigation.GridMap(RIG, navigation.Grid(cell=0.5)), seen, final=True),
    "ObservationList": Part(lambda: navigation.ObservationList(DT, capacity=12), seen, final=True),
    "RowRanging": Part(lambda: navigation.RowRanging(RIG, DT), eyes),
    "Navigator": steered("ranging"),
    "Controller": steered("published"),
}
"""Every public module. `Controller` is abstract: the published one stands for it; all are tried in the long form."""
ABSTRACT = {"BindingModel": "PublishedModel", "Controller": "Controller"}


@st.composite
def runs(draw: st.DrawFn) -> tuple[str, int, int, int, list[int]]:
    """Kind of pictures, seed, trials, time steps, and where they are cut."""
    steps = draw(st.integers(2, 7))
    lengths = draw(chunkings(steps))
    cuts = [sum(lengths[:n]) for n in range(1, len(lengths))] or [1]
    return draw(st.sampled_from(KINDS)), draw(st.integers(0, 2**31)), draw(st.integers(1, 3)), steps, cuts


def try_part(part: Part, run: tuple[str, int, int, int, list[int]]) -> None:
    kind, seed, trials, steps, cuts = run
    chance = torch.Generator().manual_seed(seed)
    streams = part.given(lambda *shape: samples((trials, steps, *shape), kind, chance))
    with torch.no_grad(), tempfile.TemporaryDirectory() as folder:
        check(part, streams, cuts, Path(folder) / "state.safetensors")


QUICK = settings(
    max_examples=4, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
)
LONG = settings(QUICK, max_examples=200, derandomize=False)


@pytest.mark.parametrize("name", PARTS)
@QUICK
@given(run=runs())
def test_chunks_batches_and_resuming_change_nothing(name: str, run: Any) -> None:
    try_part(PARTS[name], run)


@pytest.mark.parametrize("name", PARTS)
def test_outputs_depend_on_what_is_given_and_on_the_state(name: str) -> None:
    """Else all that is said above would hold of a module that does nothing."""
    part = PARTS[name]
    assert any(depends(part, kind, with_state=name in WAITING) for kind in ("noise", "edges"))


WAITING = {"Windows", "GridMap", "Navigator", "Controller"}
"""Modules that give the same in their first steps, whatever they see: what they keep is not the same."""


def depends(part: Part, kind: str, with_state: bool) -> bool:
    """Whether other pictures of this kind, and another state, give something else."""

    def made(streams: Any, state: Any = None) -> dict[str, Tensor]:
        out, kept = part.run(streams, state)
        return out | leaves(kept, "state") if with_state else out

    chance = torch.Generator().manual_seed(1)
    one, other = (part.given(lambda *shape: samples((2, 8, *shape), kind, chance)) for _ in range(2))
    if not part.batched:
        one, other = trial(one, 0), trial(other, 0)
    dim = int(part.batched)
    late = cut(one, dim, 6, 8)
    with torch.no_grad():
        if not differ(made(one), made(other)):
            return False
        return not part.state or differ(made(late, part.run(cut(one, dim, 0, 6))[1]), made(late))


def differ(a: dict[str, Tensor], b: dict[str, Tensor]) -> bool:
    """Whether two runs gave something else."""
    assert a.keys() == b.keys()
    return any(a[name].shape != b[name].shape or not torch.equal(a[name], b[name]) for name in a)


@pytest.mark.long
@pytest.mark.parametrize("name", [*PARTS, *(f"Navigator {name}" for name in navigation.controller_names())])
@LONG
@given(run=runs())
def test_the_same_for_many_inputs(name: str, run: Any) -> None:
    try_part(PARTS.get(name) or steered(name.split()[1]), run)


def numbers(seed: int, *shape: int) -> Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def close(got: Tensor, wanted: Tensor | float) -> None:
    wanted = torch.as_tensor(wanted, dtype=got.dtype)
    torch.testing.assert_close(got, wanted.expand_as(got), rtol=1e-9, atol=1e-9)


def a_dog_spectrum_is_even_and_sums_to_zero(seed: int, n: int) -> None:
    at, angle = numbers(seed, 2, n) - 0.5, float(numbers(seed + 1, 1)) * math.pi
    close(vision.dog_spectrum(*at, angle), vision.dog_spectrum(*-at, angle + math.pi))
    close(vision.dog_spectrum(*(0 * at), angle), 0.0)


def fields_add_up_to_one(seed: int, n: int) -> None:
    points = numbers(seed, 2 * n) * 4 * n
    assert vision.field_weights(points, 4 * n, n).shape == (n, 2 * n)
    for border in ("wrap", "reflect"):
        close(vision.field_weights(points, 4 * n, max(n, 3), border).sum(0), 1.0)


def a_speed_curve_is_judged_the_same_in_any_unit(seed: int, n: int) -> None:
    speeds, answers = numbers(seed, n).cumsum(0) + 0.1, numbers(seed + 1, 3, n)
    curve = vision.judge_speed_curve(speeds, answers)
    assert set(curve.monotonic_to.tolist()) <= {0.0, *speeds.tolist()}
    close(vision.judge_speed_curve(7 * speeds, answers).monotonic_to, 7 * curve.monotonic_to)
    close(torch.stack(vision.judge_speed_curve(speeds, answers[1])), torch.stack([part[1] for part in curve]))


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


def a_share_is_a_share(seed: int, n: int) -> None:
    tau, dt = (float(v) for v in numbers(seed, 2) * 10.0**n)
    assert 0 < vision.smoothing_factor(tau, dt + 1e-9) <= 1
    with pytest.raises(InputError):
        vision.smoothing_factor(-tau - 1e-9, dt)
    with pytest.raises(InputError):
        vision.smoothing_factor(tau, -dt)


def the_largest_magnitude_has_no_place(seed: int, n: int) -> None:
    x = numbers(seed, 2, 1, n, n) - 0.5
    close(vision.spatial_maximum(x), x.abs().flatten(-2).max(-1).values)
    close(vision.spatial_maximum(-x.roll(1, -1)), vision.spatial_maximum(x))


def a_response_is_the_same_in_chunks(seed: int, n: int) -> None:
    x, sensor = numbers(seed, n + 2, 1, 1, 9), vision.NDMin().double()
    close(vision.speed_response(sensor, x.split(2), 1), vision.speed_response(sensor, [x], 1))
    with pytest.raises(InputError):
        vision.speed_response(sensor, [x], len(x))


def learned(seed: int, trials: int = 2) -> Any:
    return binding.InhibitoryNetwork(settle=0.02).double()(numbers(seed, trials, 12, 10))[1]


def alternation_is_a_share(seed: int, n: int) -> None:
    share = binding.alternation(learned(seed, n))
    assert share.shape == (n,)
    assert bool(((share >= 0) & (share <= 1 + 1e-9)).all())


def a_change_of_weights_is_a_size(seed: int, n: int) -> None:
    change = binding.weight_change(learned(seed, n))
    assert change.shape == (n,)
    assert bool((change >= 0).all())


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


def rules_go_by_name(seed: int, n: int) -> None:
    rule = binding.learning_rule("competitive", gamma=float(n))
    weights, _ = rule.bounded(positive(seed, n + 1, 5.0))
    assert float(binding.spectral_radius(weights).max()) <= 0.95 + 1e-4
    with pytest.raises(InputError):
        binding.learning_rule(f"competitive{n}")


def a_limited_radius_keeps_its_limit(seed: int, n: int) -> None:
    weights, limit = positive(seed, n + 1, 3.0), 0.05 + float(numbers(seed, 1))
    out = binding.limit_spectral_radius(weights, limit)
    assert float(binding.spectral_radius(out).max()) <= limit * (1 + 2e-4)
    assert bool(((out >= 0) & (out <= weights + 1e-12)).all())
    close(binding.limit_spectral_radius(weights[1], limit), out[1])


def a_radius_scales_with_its_weights(seed: int, n: int) -> None:
    weights = positive(seed, n)
    radius = binding.spectral_radius(weights)
    close(binding.spectral_radius(weights.mT), radius)
    close(binding.spectral_radius(3 * weights), 3 * radius)
    close(binding.spectral_radius(weights[2]), radius[2])


def every_solution_separates(seed: int, n: int) -> None:
    mixing = numbers(seed, 4, 1 + n % 4) + 0.1
    solutions = binding.solutions(mixing)
    assert len(solutions) == math.perm(4, 1 + n % 4)
    for solution in solutions:
        gains = binding.separated(mixing, solution.weights) / mixing.max()
        assert bool(((gains.abs() > 1e-6).sum(0) == 1).all())
        assert bool(((gains.abs() > 1e-6).sum(1) <= 1).all())


def a_state_comes_back_from_its_file(seed: int, n: int) -> None:
    model = binding.PublishedModel(PublishedConfig(size=SIZE, fps=100.0))
    _, state = model(numbers(seed, n, 3, *SIZE).float())
    with tempfile.TemporaryDirectory() as folder:
        binding.save_state(state, Path(folder) / "state", {"a": str(n)})
        kept, about = binding.load_state(Path(folder) / "state", model)
    assert about == {"a": str(n)}
    same_leaves(kept, state)
    same_leaves(binding.to_device(state, "cpu"), state)


def same_leaves(a: Any, b: Any) -> None:
    assert type(a) is type(b)
    assert leaves(a).keys() == leaves(b).keys() != set()
    assert all(
        torch.equal(x, y) and x.dtype == y.dtype for x, y in zip(leaves(a).values(), leaves(b).values(), strict=True)
    )


def what_cannot_be_trained_is_refused(seed: int, n: int) -> None:
    for wrong in ({"gamma": -float(n)}, {"radius": float(n)}, {"radius": math.nan}, {"dt": -0.01}):
        with pytest.raises(InputError):
            binding.train_first_stage(**wrong)  # type: ignore[arg-type]


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
    one, other = navigation.Avoider(RIG, DT), navigation.Avoider(RIG, DT)
    state = again = None
    for left, right in frames:
        (speed, curvature), state = one(left, right, state)
        resumed, again = other(left, right, None if again is None else pickle.loads(pickle.dumps(again)))
        assert resumed == (speed, curvature)
        assert 0 <= speed <= 1
        assert np.isfinite(curvature)


FUNCTIONS: dict[str, Callable[[int, int], None]] = {
    "Avoider": an_avoider_stays_within_its_speeds_and_goes_on_where_it_was,
    "dog_spectrum": a_dog_spectrum_is_even_and_sums_to_zero,
    "field_weights": fields_add_up_to_one,
    "judge_speed_curve": a_speed_curve_is_judged_the_same_in_any_unit,
    "low_pass_step": a_low_pass_stays_between,
    "row_shift": nothing_moves_between_equal_rows,
    "smoothing_factor": a_share_is_a_share,
    "spatial_maximum": the_largest_magnitude_has_no_place,
    "speed_response": a_response_is_the_same_in_chunks,
    "alternation": alternation_is_a_share,
    "weight_change": a_change_of_weights_is_a_size,
    "object_table": objects_have_one_owner_each,
    "bound_objects": objects_have_one_owner_each,
    "describe": objects_have_one_owner_each,
    "learning_rule": rules_go_by_name,
    "limit_spectral_radius": a_limited_radius_keeps_its_limit,
    "spectral_radius": a_radius_scales_with_its_weights,
    "solutions": every_solution_separates,
    "separated": every_solution_separates,
    "save_state": a_state_comes_back_from_its_file,
    "load_state": a_state_comes_back_from_its_file,
    "to_device": a_state_comes_back_from_its_file,
    "train_first_stage": what_cannot_be_trained_is_refused,
    "controller_names": controllers_go_by_name,
    "make_controller": controllers_go_by_name,
    "cut_strips": strips_are_cut_out,
}
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


ODD = (
    0,
    1,
    -1,
    2,
    7,
    0.5,
    -0.5,
    1e-9,
    1e9,
    1e308,
    -1e308,
    math.nan,
    math.inf,
    -math.inf,
    10**400,
    True,
    None,
    "x",
    (1,),
)


def numbers_of(kind: type) -> dict[str, Any]:
    """The fields of a class of numbers, with their defaults."""
    if issubclass(kind, pydantic.BaseModel):
        return {name: part.get_default(call_default_factory=True) for name, part in kind.model_fields.items()}
    made = {part.name: part.default for part in dataclasses.fields(kind) if part.default is not dataclasses.MISSING}
    needed = [part for part in dataclasses.fields(kind) if part.default_factory is part.default is dataclasses.MISSING]
    return {} if needed else made


def is_numbers(thing: Any) -> bool:
    """Whether it is a class of numbers that all have defaults."""
    if not inspect.isclass(thing) or not (dataclasses.is_dataclass(thing) or issubclass(thing, pydantic.BaseModel)):
        return False
    return bool(numbers_of(thing))


CLASSES = {
    name: getattr(module, name) for module in PUBLIC for name in module.__all__ if is_numbers(getattr(module, name))
}


@pytest.mark.parametrize("name", CLASSES)
def test_numbers_are_taken_as_they_are_or_refused_in_one_line(name: str) -> None:
    bad = []
    kind = CLASSES[name]
    for part, value in ((part, value) for part in numbers_of(kind) for value in ODD):
        try:
            made = kind(**{part: value})
        except (InputError, pydantic.ValidationError) as error:
            if isinstance(error, InputError) and (part not in str(error) or "\n" in str(error)):
                bad.append(f"{part}={value!r}: the message is {error}")
            continue
        except Exception as error:
            bad.append(f"{part}={value!r}: {type(error).__name__}: {error}")
            continue
        wanted = numbers_of(kind)[part]
        taken = getattr(made, part)
        if isinstance(value, str | tuple) and not isinstance(wanted, type(value)) and taken == value:
            bad.append(f"{part}={value!r} is taken")
        if isinstance(wanted, float | int) and isinstance(value, float) and math.isnan(value):
            bad.append(f"{part}=nan is taken")
    assert not bad


def test_nothing_public_is_left_out() -> None:
    """A new module needs its `Part`, a new function its property; what only holds numbers is tried as it is."""
    public = {name: getattr(module, name) for module in PUBLIC for name in module.__all__}
    left = {
        name
        for name, thing in public.items()
        if inspect.isfunction(thing)
        or (inspect.isclass(thing) and not issubclass(thing, tuple) and not inspect.isabstract(thing))
    }
    asked = {*PARTS, *FUNCTIONS, *CLASSES, *HELD_BY}
    assert sorted(left - asked) == []
    assert sorted(name for name in asked if name not in public) == []
    modules = {name for name, thing in public.items() if inspect.isclass(thing) and issubclass(thing, nn.Module)}
    assert modules - set(PARTS) == {"BindingModel"}


HELD_BY = {
    "BoundObject": "bound_objects",
    "LearningRule": "learning_rule",
}
"""Classes without defaults, and the property in which they are made."""


TUPLES = {
    name: getattr(module, name)
    for module in PUBLIC
    for name in module.__all__
    if inspect.isclass(getattr(module, name)) and issubclass(getattr(module, name), tuple)
}


@pytest.mark.parametrize("name", TUPLES)
def test_tuples_are_walked_over_and_put_together_again(name: str) -> None:
    kind = TUPLES[name]
    tree = kind(*(torch.full((2,), float(n)) for n in range(len(kind._fields))))
    assert [float(part[0]) for part in leaves(tree).values()] == list(map(float, range(len(kind._fields))))
    same_leaves(mapped(tree, lambda _, part: part), tree)
