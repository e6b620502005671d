"""Public calls, constructors and models with values that nobody means: an `InputError` of one line."""

from __future__ import annotations

import dataclasses
import inspect
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pydantic
import pytest
import torch

import ndtorch
from ndtorch import binding, scenes, vision
from ndtorch.binding import BindingModel
from ndtorch.errors import InputError
from tests.public_calls import ODD, PACKAGES, RIGHT, calls_of, needed_by, places_of, public_things

VALUES: tuple[Any, ...] = (
    *(None, True, "x", object(), 1.5, -1, 0, math.nan, 1e18, [None], torch.zeros(0), torch.zeros(3, 2, 7)),
    *(np.zeros((2, 3)), vision.FilterState(torch.zeros(1))),
)


SHAPES = tuple(map(torch.zeros, ((0,), (2,), (2, 0, 3), (3, 2, 7), (1, 1, 1, 1, 1, 1, 1))))


def contract() -> list[str]:
    """What every model offers: the public methods of `BindingModel` that read a state or frames."""
    methods = {name: member for name, member in vars(BindingModel).items() if inspect.isfunction(member)}
    taken = {"state", "frames"}
    return ["forward", *(n for n, m in methods.items() if n[0] != "_" and taken & set(inspect.signature(m).parameters))]


@pytest.mark.parametrize("name", ["published", "scale-free", "retinotopic", "foreground"])
@pytest.mark.parametrize("method", contract())
def test_a_model_refuses_what_is_no_state_and_no_frames(name: str, method: str) -> None:
    model = ndtorch.load(name, size=48)
    call: Callable[..., Any] = getattr(model, method)
    others = [
        ndtorch.load(other, size=48)(torch.zeros(2, 3, 48, 48))[1] for other in {"published", "scale-free"} - {name}
    ]
    for value in (*VALUES, *(others if method not in ("forward", "signals") else ())):
        with pytest.raises(InputError) as caught:
            call(*[value] * len(inspect.signature(call).parameters)) if method == "restore_closed" else call(value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", VALUES[:1] + VALUES[3:5])
def test_paths_are_text_or_paths(value: object, tmp_path: Path) -> None:
    model = ndtorch.load("retinotopic", size=48)
    for call in (ndtorch.load, ndtorch.navigation.load_map, model.save):
        with pytest.raises(InputError, match="must be a"):
            call(value)  # type: ignore[arg-type]
    model.save(str(tmp_path / "text"))
    assert ndtorch.load(str(tmp_path / "text")).config == ndtorch.load(tmp_path / "text").config


def described(value: object) -> str:
    return str(tuple(value.shape)) if isinstance(value, torch.Tensor) else repr(value)[:20]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_call_answers_odd_values_in_one_line(
    package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever it is given in place of one argument, what comes is an `InputError` or, for a value that it takes, an
    answer."""
    pytest.importorskip("serial")
    pytest.importorskip("rerun")
    monkeypatch.chdir(tmp_path)
    raw = []
    for name, thing in public_things():
        if name.rpartition(".")[0] != package:
            continue
        for method, call in calls_of(thing):
            for place in places_of(call):
                for value in (*ODD, *(SHAPES if "Tensor" in str(place.annotation) else ())):
                    given = {**needed_by(call), place.name: value}
                    by_place = [given.pop(p.name) for p in places_of(call) if p.kind is p.POSITIONAL_ONLY]
                    try:
                        answer = call(*by_place, **given)
                        if inspect.isgenerator(answer):
                            next(answer, None)
                    except OSError:  # the file system has its own words
                        pass
                    except InputError as error:
                        if "\n" in str(error):
                            raw.append(f"{name}{method}({place.name}={described(value)}): several lines")
                    except Exception as error:
                        raw.append(f"{name}{method}({place.name}={described(value)}): {type(error).__name__}: {error}")
    assert not raw


NUMBERS: tuple[Any, ...] = (
    *(math.nan, -math.inf, math.inf, -1, -0.5, 0, 2.5, True, 10**400, None, "x", [1], [math.nan]),
    *((math.nan, 1), (-1, 1), (0, 0), (1, 2, 3)),
)

ENDLESS = {"reach", "lifetime", "memory", "radius_limit"}
"""What may be infinite, beside time constants."""

ELSEWHERE = {
    "BarScene",
    "BoundObject",
    "MovingGrating",
    "Navigator",
    "VideoWriter",
    "object_table",
    "train_first_stage",
}
"""What is told rather than asked for, takes lists of numbers, is made of the others, or takes long."""


def tables(thing: object) -> bool:
    """Whether it is a table of constants, which tests/test_numbers.py tries."""
    if not inspect.isclass(thing):
        return False
    return issubclass(thing, tuple | pydantic.BaseModel) or (
        dataclasses.is_dataclass(thing) and thing is not binding.LearningRule and thing is not scenes.Bar
    )


def makers() -> dict[str, tuple[Callable[..., Any], dict[str, Any]]]:
    """What can be made of numbers, by name, and what it has to be given."""
    found = {}
    for name, thing in public_things(("ndtorch.vision", "ndtorch.binding", "ndtorch.navigation", "ndtorch.scenes")):
        given = needed_by(thing) | ({"size": (64, 80)} if "size" in inspect.signature(thing).parameters else {})
        odd = inspect.isabstract(thing) or tables(thing) or thing.__name__ in ELSEWHERE
        if not odd and given.keys() <= RIGHT.keys():
            found[name.rpartition(".")[2]] = (thing, given)
    return found


MAKERS = makers()


def numbers_of(name: str) -> dict[str, Any]:
    """The parameters that are numbers, sizes or places, and what they are in a good call."""
    make, given = MAKERS[name]
    found = {}
    for place in inspect.signature(make).parameters.values():
        usual, kind = given.get(place.name, place.default), str(place.annotation)
        number = isinstance(usual, int | float) and not isinstance(usual, bool)
        pair = isinstance(usual, tuple) and bool(usual) and isinstance(usual[0], int | float)
        if number or pair or (usual is None and ("float" in kind or "int" in kind) and "Callable" not in kind):
            found[place.name] = usual
    return found


def wrong(place: inspect.Parameter, usual: Any, value: Any) -> bool:
    """Whether a value can never be right there; others may be taken or refused."""
    kind, name = str(place.annotation), place.name
    several = ("PerScene", "PerBar", "Sequence", "Tensor", "tuple")
    lists = isinstance(usual, tuple) or name == "seed" or any(word in kind for word in several)
    if value is None:
        return place.default is not None and "None" not in kind and name != "orientation"
    if isinstance(value, str) or value == [math.nan] or (isinstance(value, tuple) and value[0] is math.nan):
        return True
    if isinstance(value, list | tuple):
        return not lists
    if value == 10**400:
        return isinstance(usual, float)
    if value == math.inf:
        return not (name.startswith("tau") or name in ENDLESS)
    return not math.isfinite(value)


def outcome(name: str, part: str, value: Any) -> str:
    """What came of it: "" where it was refused by name, or may be what it is."""
    make, given = MAKERS[name]
    try:
        make(**{**given, part: value})
    except InputError as error:
        said = str(error)
        return "" if part in said and "\n" not in said else f"not named: {said}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    place = inspect.signature(make).parameters[part]
    return "taken" if wrong(place, given.get(part, place.default), value) else ""


@pytest.mark.parametrize("name", [name for name in MAKERS if numbers_of(name)])
def test_odd_numbers_are_refused_by_name(name: str) -> None:
    make, given = MAKERS[name]
    make(**given)
    tried = [(part, value) for part in numbers_of(name) for value in NUMBERS]
    bad = [f"{part}={str(value)[:20]}: {found}" for part, value in tried if (found := outcome(name, part, value))]
    assert not bad


def test_numbers_of_numpy_are_numbers() -> None:
    frame = scenes.two_bars(seconds=0.1, fluctuation="random", seed=np.int64(3), size=(np.int64(200), 200))
    plain = scenes.two_bars(seconds=0.1, fluctuation="random", seed=3, size=(200, 200))
    assert torch.equal(frame.frames(0, 1), plain.frames(0, 1))
    assert binding.InhibitoryNetwork(np.int64(3), np.float32(0.01)).neurons == 3
    assert binding.ObjectFiles((np.int64(4), 5), np.float64(4.0)).grid == (4, 5)
    assert vision.VisualFeatures(np.zeros((16, 20)).shape, np.float64(0.01)).size == (16, 20)
