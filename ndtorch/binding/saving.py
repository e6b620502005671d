"""States to files and back: nested tuples of tensors as one safetensors file, without pickle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ndtorch.binding.models.published import BindingState
from ndtorch.binding.models.scale_free import StageState
from ndtorch.binding.network import NetworkState
from ndtorch.binding.normalise import InputState
from ndtorch.binding.readout.delays import DelayState
from ndtorch.binding.readout.owners import StatisticsState
from ndtorch.errors import InputError
from ndtorch.vision.motion import MotionState
from ndtorch.vision.resample import ResampleState
from ndtorch.vision.temporal import FilterState


def flatten_state(state: Any, prefix: str = "") -> dict[str, Tensor]:
    """A nested tuple of tensors as a flat dict with dotted names; parts that are None are left out."""
    flat: dict[str, Tensor] = {}
    for name, part in state._asdict().items():
        if isinstance(part, Tensor):
            flat[prefix + name] = part.contiguous().clone()
        elif part is not None:
            flat |= flatten_state(part, f"{prefix}{name}.")
    return flat


def save_state(state: BindingState, path: str | Path, about: Mapping[str, str] | None = None) -> None:
    """Write a state, and strings that say what it belongs to, as safetensors."""
    from safetensors.torch import save_file

    save_file(flatten_state(state), str(path), metadata=dict(about or {}))


def load_state(path: str | Path) -> tuple[BindingState, dict[str, str]]:
    """Read what `save_state` wrote: the state, bit for bit, and the strings.

    Raises:
        InputError: missing file, not safetensors, or parts missing.
    """
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(str(path), framework="pt") as file:
            tensors: dict[str, Tensor] = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
            about: dict[str, str] = file.metadata() or {}
    except FileNotFoundError:
        raise InputError(f"{path} is missing") from None
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path} is not a saved state: {error}") from None

    def part(kind: Any, prefix: str) -> Any:
        missing = [prefix + name for name in kind._fields if prefix + name not in tensors]
        if missing:
            raise InputError(f"{path} is not a saved state of this model: {', '.join(missing)} missing")
        return kind(**{name: tensors[prefix + name] for name in kind._fields})

    motion = part(MotionState, "motion.") if any(name.startswith("motion.") for name in tensors) else None
    first = None
    second: NetworkState | StageState
    if any(name.startswith("second.network.") for name in tensors):
        second = StageState(
            part(FilterState, "second.smooth."),
            part(NetworkState, "second.network."),
            part(StatisticsState, "second.statistics."),
            part(DelayState, "second.delays."),
        )
    else:
        first, second = part(NetworkState, "first."), part(NetworkState, "second.")
    state = BindingState(motion, part(ResampleState, "resample."), part(InputState, "inputs."), first, second)
    return state, about


def to_device(state: BindingState, device: torch.device | str) -> BindingState:
    """The same state on another device; counters stay on the CPU."""

    def move(part: Any) -> Any:
        if part is None:
            return None
        if isinstance(part, Tensor):
            return part if part.dtype == torch.int64 else part.to(device)
        return type(part)(*(move(inner) for inner in part))

    moved: BindingState = move(state)
    return moved
