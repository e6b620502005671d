"""What a navigator passes from step to step."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.arguments import check_dense, check_finite, check_tensor
from ndtorch.errors import InputError
from ndtorch.navigation.controllers.contract import Command
from ndtorch.navigation.localisation.localiser import LocaliserState
from ndtorch.navigation.mapping import GridMapState
from ndtorch.navigation.mapping.feature_tracks import Tracks
from ndtorch.navigation.mapping.observations import Observations
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.stereo.ranging import Ranges, StereoRangingState
from ndtorch.utils.tensors import leaves


class NavigatorState(NamedTuple):
    """State of `Navigator`, and what it last saw: tensors, or arrays and numbers where the backend is `"numba"`.

    Attributes:
        fields, rows: states of what reads the subfields and the horizon rows; None has them settle on the next frame.
        control: the controller's own state, a NamedTuple.
        command: the last command, `[...]`, driven until the next frame.
        pose: where the car was at the last frame by dead reckoning, `[...]`; `place` is the corrected one.
        sides: speed estimates of the last frame, `[..., 2]`.
        difference: what the controller weighed then, `[...]`; `Controller.trace` says what it is.
        ranges: of the last frame, `[..., n]`.
        map, observations, tracks, located: states of those parts, None where the navigator has none.
    """

    fields: Any
    rows: StereoRangingState | None
    control: Any
    command: Command
    pose: Pose
    sides: Any
    difference: Any
    ranges: Ranges
    map: GridMapState | None
    observations: Observations | None
    tracks: Tracks | None
    located: LocaliserState | None = None

    @property
    def place(self) -> Pose:
        """Where the car was at the last frame as far as is known, `[...]`: corrected where there is a localiser."""
        return self.pose if self.located is None else pose_like(self.pose, self.located.pose)


def pose_like(pose: Pose, values: Any) -> Pose:
    """An array `[3]` as a pose of tensors or of numbers, as another one is."""
    if isinstance(pose.x, Tensor):
        return Pose(*pose.x.new_tensor(values).unbind())
    return Pose(*values.tolist())


def check_like(state: NavigatorState, fresh: NavigatorState) -> None:
    """Raise `InputError` for the first tensor of a state that is of another kind than that of a fresh one.

    What either of them lacks, and the sizes of what is remembered, are not looked at.
    """
    known = leaves(fresh)
    for name, value in leaves(state._replace(located=None)).items():
        check_dense(f"state.{name}", value)
        wanted = known.get(name)
        if wanted is None or name.startswith("map."):
            continue
        if value.shape != wanted.shape:
            raise InputError(f"state.{name} must be {tuple(wanted.shape)}, got {tuple(value.shape)}")
        if value.is_floating_point() != wanted.is_floating_point():
            raise InputError(f"state.{name} must be {wanted.dtype}, got {value.dtype}")


def check_motion(driven: Command | None, start: Pose | None, frames: tuple[int, ...]) -> None:
    """Raise `InputError` for what was driven, or a start, that is not finite: it would stay in the pose for good.

    Args:
        frames: shape `[..., T]` of the frames.
    """
    for name, given, shape in (("driven", driven, frames), ("start", start, frames[:-1])):
        for part, value in zip(given._fields, given, strict=True) if given is not None else ():
            value = torch.tensor(value) if isinstance(value, float) else value
            check_tensor(f"{name}.{part}", value)
            if value.shape != shape:
                raise InputError(f"{name}.{part} must be {list(shape)}, got {list(value.shape)}")


def check_known(state: NavigatorState) -> None:
    """Raise `InputError` for a pose or a last command that is not finite: it would stay in the pose for good."""
    numbers = (*state.pose, *state.command)
    if all(type(number) is float for number in numbers) and math.isfinite(sum(numbers)):
        return
    for name, part in (("pose", state.pose), ("command", state.command)):
        for field, value in zip(part._fields, part, strict=True):
            check_finite(f"state.{name}.{field}", torch.as_tensor(value))


def check_cars(state: NavigatorState, batch: tuple[int, ...]) -> None:
    """Raise `InputError` unless the state of compiled steps is of so many cars."""
    if not batch and all(type(value) is float for value in state.pose):
        return
    for name, value in zip(Pose._fields, state.pose, strict=True):
        if np.shape(value) != batch or not (isinstance(value, float) or getattr(value, "dtype", None) == np.float64):
            kind = getattr(value, "dtype", type(value).__name__)
            raise InputError(f"state.pose.{name} must be {list(batch)} of float64, got {kind} {list(np.shape(value))}")


def one_car(tree: Any, n: int, dims: int) -> Any:
    """The state of one of a batch whose `dims` leading dimensions count cars."""
    if tree is None:
        return None
    if isinstance(tree, Tensor):
        return tree.flatten(0, dims - 1)[n]
    if isinstance(tree, np.ndarray):
        part = tree.reshape(-1, *tree.shape[dims:])[n]
        return part if part.ndim else part.item()
    parts = [one_car(part, n, dims) for part in tree]
    return type(tree)(*parts) if hasattr(tree, "_fields") else type(tree)(parts)


def all_cars(trees: list[Any], batch: tuple[int, ...]) -> Any:
    """The opposite of `one_car`: the states of all cars as one, every part `[*batch, ...]`."""
    first = trees[0]
    if first is None:
        return None
    if isinstance(first, Tensor):
        return torch.stack(trees).reshape(*batch, *first.shape)
    if not isinstance(first, tuple):
        stacked = np.stack([np.asarray(tree) for tree in trees])
        return stacked.reshape(*batch, *stacked.shape[1:])
    parts = [all_cars(list(part), batch) for part in zip(*trees, strict=True)]
    return type(first)(*parts) if hasattr(first, "_fields") else type(first)(parts)
