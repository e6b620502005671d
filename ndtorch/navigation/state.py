"""What a navigator passes from step to step."""

from __future__ import annotations

from typing import Any, NamedTuple

from torch import Tensor

from ndtorch.arguments import check_dense, check_tensor
from ndtorch.errors import InputError
from ndtorch.navigation.controllers.contract import Command
from ndtorch.navigation.localisation.state import LocaliserState
from ndtorch.navigation.mapping import GridMapState
from ndtorch.navigation.mapping.feature_tracks import Tracks
from ndtorch.navigation.mapping.observations import Observations
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.row_ranging import RowRangingState
from ndtorch.utils.tensors import leaves
from ndtorch.vision.temporal import FilterState


class NavigatorState(NamedTuple):
    """State of `Navigator`, and what it last saw.

    Attributes:
        fields, rows: states of what reads the subfields and the horizon rows; None has them settle on the next frame.
        control: the controller's own state, a NamedTuple of tensors.
        command: the last command, `[...]`, driven until the next frame.
        pose: where the car was at the last frame by dead reckoning, `[...]`; `place` is the corrected one.
        sides: speed estimates of the last frame, `[..., 2]`.
        difference: what the controller weighed then, `[...]`; `Controller.trace` says what it is.
        ranges: of the last frame, `[..., n]`.
        map, observations, tracks, located: states of those parts, None where the navigator has none.
    """

    fields: FilterState | None
    rows: RowRangingState | None
    control: Any
    command: Command
    pose: Pose
    sides: Tensor
    difference: Tensor
    ranges: Ranges
    map: GridMapState | None
    observations: Observations | None
    tracks: Tracks | None
    located: LocaliserState | None = None

    @property
    def place(self) -> Pose:
        """Where the car was at the last frame as far as is known, `[...]`: corrected where there is a localiser."""
        return place_of(self.pose, self.located)


def place_of(pose: Pose, located: LocaliserState | None) -> Pose:
    """Where a car is whose dead reckoning has led to `pose`: corrected where there is a localiser."""
    return pose if located is None else Pose(*pose.x.new_tensor(located.pose).unbind())


class Packed(NamedTuple):
    """What the tensors of a state are views of, as kernels take it; `look_around` says what is where."""

    large: Any
    small: Any


class StepState(NavigatorState):
    """A state that the kernel of a whole step made: the next one need not gather its numbers.

    What is made of it, by `_replace`, by copying or by loading, is a plain state again, or one without `packed`.

    Attributes:
        packed: None where something of it was replaced.
    """

    packed: Packed | None = None

    def __reduce__(self) -> tuple[type[NavigatorState], tuple[Any, ...]]:
        return NavigatorState, tuple(self)


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


def check_motion(driven: Command | None, start: Pose | None) -> None:
    """Raise `InputError` for what was driven, or a start, that is not finite: it would stay in the pose for good."""
    for name, given, kind in (("driven", driven, Command), ("start", start, Pose)):
        if given is None:
            continue
        if not isinstance(given, kind):
            raise InputError(f"{name} must be a {kind.__name__}, got {type(given).__name__}")
        for part, value in zip(kind._fields, given, strict=True):
            check_tensor(f"{name}.{part}", value)
            if name == "driven" and value.ndim < 1:
                raise InputError(f"{name}.{part} must be [..., T], got a single number")
