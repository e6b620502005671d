"""States to files and back: nested tuples of tensors as one safetensors file, without pickle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import Tensor

from ndtorch.arguments import as_path
from ndtorch.binding.models.base import BindingModel
from ndtorch.errors import InputError
from ndtorch.foreground.tracker import Tracks
from ndtorch.utils.files import read_tensors, save_tensors
from ndtorch.utils.tensors import leaves, mapped, parts

State = TypeVar("State")

COUNTERS = ("resample.taken", "frames", "windows.steps")
"""Parts of the states of the models that count frames."""


def save_state(state: Any, path: str | Path, about: Mapping[str, str] | None = None) -> None:
    """Write a state of any model, and strings that say what it belongs to, as safetensors with a checksum.

    A file that was there stays until the new one is whole.

    Raises:
        InputError: what is no nested tuple of tensors.
        OSError: it cannot be written.
    """
    if not isinstance(state, tuple) or not leaves(state):
        raise InputError(f"state must be a nested tuple of tensors, got {repr(state)[:40]}")
    tensors = {name: part.contiguous().clone() for name, part in leaves(state).items()}
    save_tensors(tensors, as_path("path", path), about)


def read_about(path: str | Path) -> dict[str, str]:
    """The strings that `save_state` wrote beside the state. Raises `InputError`: missing file, or not safetensors."""
    return read_tensors(path, "a saved state")[1]


def load_state(path: str | Path, model: BindingModel) -> tuple[Any, dict[str, str]]:
    """Read what `save_state` wrote: a state of that model, bit for bit, and the strings.

    Raises:
        InputError: missing file, not safetensors, or not a state of this model: parts that are missing, of another
            shape or type, or not finite.
    """
    tensors, about = read_tensors(path, "a saved state")
    # A state of one trial, of black frames, for its names, shapes and types.
    frames = torch.zeros(max(1, math.ceil(model.dt * model.fps - 1e-9)), 3, *model.size)
    with torch.no_grad():
        example = model(frames)[1]
    try:
        films = {name.split(".")[0] for name in tensors}
        if films and all(map(str.isdigit, films)):  # one state a film, as a batch of films has it
            state: Any = tuple(rebuilt(example, tensors, f"{n}.") for n in range(len(films)))
        else:
            state = rebuilt(example, tensors, "")
        extra = sorted(set(tensors) - set(leaves(state)))
        if extra:
            raise InputError(f"{extra[0]} does not belong to it")
    except InputError as error:
        raise InputError(f"{path} is not a saved state of this model ({model.name}): {error}") from None
    return state, about


def rebuilt(example: Any, tensors: Mapping[str, Tensor], prefix: str) -> Any:
    """A tuple like the example, of the tensors whose names begin with the prefix."""
    ragged, values = isinstance(example, Tracks), list[Any]()
    for name, part in parts(example):
        whole = prefix + name
        if isinstance(part, Tensor):
            if whole not in tensors:
                raise InputError(f"{whole} missing")
            values.append(checked(whole, tensors[whole], part, ragged))
        elif part is None or (
            "None" in str(type(example).__annotations__[name]) and not any(n.startswith(f"{whole}.") for n in tensors)
        ):
            values.append(None)
        else:
            values.append(rebuilt(part, tensors, f"{whole}."))
    return type(example)(*values)


def frames_taken(state: Any) -> int | None:
    """How many frames a state of one trial has seen since the start of its run; None where it does not say."""
    counts = leaves(state)
    return next((int(counts[name]) for name in COUNTERS if name in counts), None)


def checked(name: str, given: Tensor, example: Tensor, ragged: bool) -> Tensor:
    """A tensor if it is finite and has the type and, after those of a batch, the dimensions of the example."""
    if given.dtype != example.dtype and not (given.is_floating_point() and example.is_floating_point()):
        raise InputError(f"{name} must be {example.dtype}, got {given.dtype}")
    wanted = tuple(example.shape[1:] if ragged else example.shape)
    if given.ndim < example.ndim or tuple(given.shape[given.ndim - len(wanted) :]) != wanted:
        raise InputError(f"{name} must be {['...', *wanted]}, got {list(given.shape)}".replace("'", ""))
    if given.is_floating_point() and not torch.isfinite(given).all():
        raise InputError(f"{name} must be finite, got NaN or infinite values")
    return given


def to_device(state: State, device: torch.device | str) -> State:
    """The same state on another device; counters stay on the CPU."""
    there = torch.device(device)
    return mapped(state, lambda _, part: part if part.dtype == torch.int64 else part.to(there))
