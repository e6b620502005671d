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

VALUES: tuple[Any, ...] = (
    *(None, True, "x", object(), 1.5, -1, 0, math.nan, 1e18, [None], torch.zeros(0), torch.zeros(3, 2, 7)),
    *(np.zeros((2, 3)), vision.FilterState(torch.zeros(1))),
)


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
