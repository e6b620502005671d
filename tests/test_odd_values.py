"""What models are asked with values that nobody means: an `InputError` of one line, whatever the method."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import ndtorch
from ndtorch import vision
from ndtorch.binding import BindingModel
from ndtorch.errors import InputError
from tests.public_calls import ODD, PACKAGES, calls_of, needed_by, places_of, public_things

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
