"""What a navigator passes from step to step."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.navigation.controllers.contract import Command
from ndtorch.navigation.localisation.localiser import LocaliserState
from ndtorch.navigation.mapping.feature_tracks import Tracks
from ndtorch.navigation.mapping.grid_map import GridMapState
from ndtorch.navigation.mapping.observations import Observations
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.stereo.ranging import Ranges


class NavigatorState(NamedTuple):
    """State of `Navigator`, and what it last saw: tensors, or arrays and numbers where the backend is `"numba"`.

    Attributes:
        fields, rows: states of what reads the subfields and the horizon rows; None has them settle on the next frame.
        control: the controller's own state, a NamedTuple.
        command: the last command, `[...]`, driven until the next frame.
        pose: where the car was at the last frame by dead reckoning, `[...]`; `place` is the corrected one.
        sides: speed estimates of the last frame, `[..., 2]`.
        difference: what the controller weighed then, `[...]`; its `trace` says what it is.
        ranges: of the last frame, `[..., n]`.
        map, observations, tracks, located: states of those parts, None where the navigator has none.
    """

    fields: Any
    rows: Any
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


def pose_in(pose: Pose, unit: float) -> Pose:
    """A pose in units of so many metres."""
    return Pose(pose.x / unit, pose.y / unit, pose.heading)


def ranges_in(ranges: Ranges, unit: float) -> Ranges:
    """Ranges in units of so many metres."""
    return ranges._replace(left_range=ranges.left_range / unit, x=ranges.x / unit, y=ranges.y / unit)


def pose_like(pose: Pose, values: Any) -> Pose:
    """An array `[3]` as a pose of tensors or of numbers, as another one is."""
    return Pose(*(pose.x.new_tensor(values).unbind() if isinstance(pose.x, Tensor) else values.tolist()))


def one_car(tree: Any, n: int, dims: int) -> Any:
    """The state of one of a batch whose `dims` leading dimensions count cars."""
    if isinstance(tree, Tensor):
        return tree.flatten(0, dims - 1)[n]
    if isinstance(tree, np.ndarray):
        part = tree.reshape(math.prod(tree.shape[:dims]), *tree.shape[dims:])[n]
        return part if part.ndim else part.item()
    return None if tree is None else made_like(tree, [one_car(part, n, dims) for part in tree])


def all_cars(trees: list[Any], batch: tuple[int, ...]) -> Any:
    """The opposite of `one_car`: the states of all cars as one, every part `[*batch, ...]`."""
    first = trees[0]
    if isinstance(first, Tensor):
        return torch.stack(trees).reshape(*batch, *first.shape)
    if first is None or isinstance(first, tuple):
        return first and made_like(first, [all_cars(list(part), batch) for part in zip(*trees, strict=True)])
    stacked = np.stack([np.asarray(tree) for tree in trees])
    return stacked.reshape(*batch, *stacked.shape[1:])


def made_like(tree: Any, parts: list[Any]) -> Any:
    """A tuple or NamedTuple like another one, of other parts."""
    return type(tree)(*parts) if hasattr(tree, "_fields") else type(tree)(parts)
