"""What every model keeps where, and what it refuses at its edge, in one line."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

import ndtorch
from ndtorch.binding import RetinotopicModel
from ndtorch.errors import InputError
from ndtorch.scenes import equal_bars

NAMES = ("published", "scale-free", "retinotopic")


def held(thing: Any, place: str, seen: dict[int, Any]) -> Iterator[tuple[str, Tensor]]:
    """Every tensor that can be reached from a thing, however it is kept there, and where."""
    if id(thing) in seen:
        return
    seen[id(thing)] = thing
    if isinstance(thing, Tensor):
        yield place, thing
        return
    parts: dict[Any, Any] = {}
    if isinstance(thing, dict):
        parts = thing
    elif isinstance(thing, tuple | list | set | frozenset):
        parts = dict(enumerate(thing))
    elif not isinstance(thing, type):
        closure = getattr(thing, "__closure__", None) or ()
        parts = {**getattr(thing, "__dict__", {}), **{n: cell.cell_contents for n, cell in enumerate(closure)}}
    for name, part in parts.items():
        yield from held(part, f"{place}.{name}", seen)


@pytest.mark.parametrize("name", NAMES)
def test_all_fixed_tensors_are_buffers(name: str) -> None:
    """Also those that a forward has made and kept: none of them is left behind where a model moves."""
    model = ndtorch.load(name, size=32)
    model(torch.rand(30, 3, 32, 32, generator=torch.Generator().manual_seed(0)))
    known = {id(tensor) for tensor in model.buffers()}
    assert [place for place, tensor in held(model, name, {}) if id(tensor) not in known] == []
    assert len(known) > 3
    assert {tensor.device.type for tensor in model.to("meta").buffers()} == {"meta"}


@pytest.mark.parametrize("name", NAMES)
def test_other_types_than_single_and_double_are_refused_through_every_door(name: str) -> None:
    model = ndtorch.load(name, size=32)
    around, half = nn.Sequential(model), torch.zeros(1).half()
    for convert in (
        *(model.half, model.bfloat16, around.half, around.bfloat16),
        *(lambda: model.to(torch.float16), lambda: model.to(dtype=torch.bfloat16), lambda: model.to(half)),
        *(lambda: model.type(torch.float16), lambda: around.type(torch.int32), lambda: around.type(torch.complex64)),
    ):
        with pytest.raises(InputError, match="computes in single or double precision"):
            convert()
    assert model.double().float().dtype == torch.float32


LEARNED = {
    "published": {"gamma": 0.7, "tau_in": 0.9, "tau_out": 0.4, "tau_sums": 1.1, "tau_motion_low": 0.06},
    "scale-free": {"gamma": 0.3, "leak": 1.5, "tau_out": 1.0, "tau_smooth": 0.06, "tau_motion_high": 0.4},
    "retinotopic": {"tau_motion_high": 0.4, "tau_motion_low": 0.06},
}


@pytest.mark.parametrize("name", LEARNED)
def test_constants_given_as_parameters_are_learned(name: str, tmp_path: Path) -> None:
    """Gradients are those of finite differences, also in blocks, and what is saved are the learned values."""
    given = {key: nn.Parameter(torch.tensor(value, dtype=torch.float64)) for key, value in LEARNED[name].items()}
    if name != "retinotopic":
        given["center"] = nn.Parameter(torch.tensor([4.0, 1.5], dtype=torch.float64))
    quick = {"published": {"settle": 0.0, "tau_onset": 0.0}, "scale-free": {"settle": 0.0}}.get(name, {})
    model = ndtorch.load(name, size=(18, 20), fps=50, **quick, **given).double()
    paths = [next(path for path, one in model.named_parameters() if one is value) for value in given.values()]
    assert set(paths) <= set(model.state_dict())
    frames = torch.rand(8, 3, 18, 20, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    with torch.no_grad():  # motion of the second frame is zero but for rounding, and is divided by its own largest
        _, state = model(frames.flip(0))

    def outputs(*values: torch.Tensor) -> torch.Tensor:
        signals, _ = torch.func.functional_call(model, dict(zip(paths, values, strict=True)), (frames, state))
        return signals.outputs

    assert torch.autograd.gradcheck(outputs, tuple(given.values()), eps=1e-6, atol=1e-5, fast_mode=True)
    with torch.no_grad():
        given["tau_motion_low" if name != "scale-free" else "leak"].fill_(-0.1)
    model.save(tmp_path / "model")
    again = ndtorch.load(tmp_path / "model").double()
    torch.testing.assert_close(again(frames, state)[0].outputs, outputs(*given.values()), atol=1e-6, rtol=1e-5)
    with pytest.raises(InputError, match=f"size of {name} must be a number; what it learns"):
        ndtorch.load(name, size=nn.Parameter(torch.tensor([12.0, 14.0])))


@pytest.mark.parametrize("name", [*NAMES, "foreground"])
def test_states_are_saved_by_torch_and_autocast_changes_nothing(name: str, tmp_path: Path) -> None:
    model = ndtorch.load(name, size=48)
    frames = torch.rand(4, 3, 48, 48, generator=torch.Generator().manual_seed(0))
    _, state = model(frames)
    torch.save(state, tmp_path / "state.pt")
    signals, _ = model(frames, torch.load(tmp_path / "state.pt"))
    with torch.autocast("cpu", torch.bfloat16):
        same, _ = model(frames, state)
    assert torch.equal(signals.outputs, same.outputs)
    assert torch.equal(signals.outputs, model(frames, state)[0].outputs)


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("name", [*NAMES, "foreground"])
def test_a_picture_gives_the_same_numbers_in_every_type(name: str, double: bool) -> None:
    quick = {} if name in ("foreground", "retinotopic") else {"settle": 0.0}
    model = ndtorch.load(name, size=48, fps=30, **quick)
    model = model.double() if double else model
    drawn = torch.randint(0, 256, (24, 3, 48, 48), generator=torch.Generator().manual_seed(0)).to(torch.uint8)
    wanted, after = model(drawn)
    for frames in (drawn.double() / 255, drawn.float() / 255):
        given, end = model(frames)
        assert torch.equal(given.outputs, wanted.outputs)
        assert torch.equal(model.weights(end), model.weights(after))
    finer = torch.rand(4, 3, 48, 48, generator=torch.Generator().manual_seed(1), dtype=torch.float32)
    assert torch.equal(model(finer)[0].outputs, model(finer.double())[0].outputs)
    for other in (torch.float16, torch.bfloat16, torch.int64, torch.bool):
        with pytest.raises(InputError, match="frames must be float32 or float64"):
            model(drawn.to(other))


BARS = torch.zeros(2, 10)
BARS[0, [1, 2, 4, 6, 7]] = torch.tensor([1.0, 0.6, 0.7, 0.7, 0.9])
BARS[1, [0, 2, 4, 5, 8]] = torch.tensor([1.0, 0.6, 0.7, 0.7, 0.9])


def two_things(seconds: float, fps: float = 100.0, rates: tuple[float, float] = (0.87, 1.31)) -> torch.Tensor:
    """Sums of two bars that fluctuate at their own rates, `[T, 10]`."""
    t = torch.arange(round(seconds * fps)) / fps
    light = torch.stack([1 + 0.5 * torch.sin(2 * math.pi * rate * t + 2.1 * n) for n, rate in enumerate(rates)], -1)
    return 100 * light @ BARS


@pytest.mark.parametrize("fps", [12.5, 30.0, 100.0])
def test_two_things_are_two_objects_at_any_rate(fps: float) -> None:
    model = ndtorch.load("scale-free", size=(12, 14), fps=fps)
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
    assert not model.table(state).owners.any()


SIZE = (64, 64)


def model() -> RetinotopicModel:
    loaded = ndtorch.load("retinotopic", size=SIZE, along=8)
    assert isinstance(loaded, RetinotopicModel)
    return loaded


def noise(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, 3, *SIZE, generator=torch.Generator().manual_seed(0))


def test_a_batch_is_that_many_trials() -> None:
    module, frames = model(), noise(2, 6)
    _, state = module(frames)
    assert module.objects_batch(state) == [[], []]
    assert module.verdict(state) == ["learning", "learning"]
    assert module.verdict(module(torch.zeros(2, 3, 3, *SIZE))[1]) == ["static", "static"]


def test_an_object_says_when_it_was_seen() -> None:
    module = model()
    signals, state = module(noise(12))
    windows = state.windows
    one = torch.zeros_like(windows.open)
    one[3] = True
    age = module.config.tracking.confirm + 0.04
    state = state._replace(windows=windows._replace(open=one, age=age * one.float(), unseen=0.03 * one.float()))
    (thing,) = module.objects(state)
    now = float(signals.time[-1])
    assert thing.track == 3
    assert thing.last_seen == pytest.approx(now - 0.03)
    assert thing.first_seen == pytest.approx(now - age)


@pytest.mark.slow
def test_three_equal_bars_are_three_objects() -> None:
    """Claim C8 [C §5.5.2]: wide-field sums see one object, fields see three."""
    module, state = ndtorch.load("retinotopic"), None
    with torch.inference_mode():
        for frames in equal_bars(seconds=8).chunks(8):
            _, state = module(frames, state)
    found = module.objects(state)
    assert len(found) == 3
    assert len({frozenset(thing.features) for thing in found}) == 1
    assert module.verdict(state) == "stable"
    for thing in found:
        assert thing.place is not None
        assert all(0 <= at <= 500 for at in thing.place)
        assert 0 <= thing.first_seen < 3 < 7 < thing.last_seen < 8
    assert module.visible_objects(state) != []


def test_signals_have_names_and_units_in_xarray() -> None:
    pytest.importorskip("xarray")
    signals, _ = ndtorch.load("published", size=(12, 14)).from_sums(two_things(0.5).expand(2, -1, -1))
    table = signals.to_xarray()
    assert (table.outputs.dims, table.time.units) == (("trial", "time", "signal"), "s")
    assert torch.equal(torch.from_numpy(table.sums.sel(signal="red", trial=1).values), signals.sums[1, :, 7])


@pytest.mark.parametrize("fps", [0.5, 1.0, 10_000.0])
def test_signals_of_any_rate_have_a_read_out(fps: float) -> None:
    model = ndtorch.load("scale-free", fps=fps)
    signals, state = model.from_sums(torch.rand(12, 10))
    assert signals.outputs.isfinite().all()
    assert model.objects(state) is not None
