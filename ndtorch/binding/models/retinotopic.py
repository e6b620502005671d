"""The retinotopic model: windows over local fields follow the objects, and bind what fluctuates in each of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal, NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from ndtorch.arguments import check_state, without_autocast
from ndtorch.binding.first_stage import FirstStage, first_stage_weights
from ndtorch.binding.models.base import BindingModel, Nested, Verdict, by_trial
from ndtorch.binding.models.whole_field import WholeField
from ndtorch.binding.network import settled
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.object_files import ObjectFileParams, ObjectFiles, ObjectFileState
from ndtorch.binding.objects import BoundObject, features_by_group
from ndtorch.config import Constants, ModelConfig, constant
from ndtorch.errors import InputError
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.features import FEATURES
from ndtorch.vision.frames import frames_in
from ndtorch.vision.motion import Border, MotionState
from ndtorch.vision.receptive_fields import LocalFeatures
from ndtorch.vision.temporal import safe_sqrt


class LocalFields(WholeField):
    """Overlapping fields on a coarse grid."""

    along: int = constant(16, "Fields along the shorter side of the frame.", ge=3)


class SingleReadout(Constants):
    """What each window holds, from the covariances of what it sees."""

    smallest: float = constant(1 / 3, "Ratio to the largest of its group from which on a feature is one.", ge=0)


class RetinotopicConfig(ModelConfig):
    """Constants of the model."""

    model: Literal["retinotopic"] = constant("retinotopic", "Kind of the model.")
    border: Border = constant("wrap", "Border: wrap for toroidal scenes, reflect for video.")
    fields: LocalFields = Field(default_factory=LocalFields)
    readout: SingleReadout = Field(default_factory=SingleReadout)
    tracking: ObjectFileParams = Field(default_factory=ObjectFileParams)


class RetinotopicSignals(NamedTuple):
    """What the model computed, one row a frame.

    Attributes:
        fields: the ten signals of every field, `[..., T, R, C, 10]`.
        outputs: the same through the settled first stage.
        number: of objects, `[..., T]`.
        time: seconds since the first frame, `[T]` float64.
    """

    fields: Tensor
    outputs: Tensor
    number: Tensor
    time: Tensor


@safe_state
class RetinotopicState(NamedTuple):
    """State of the detectors and of the windows; no detectors in one that came from signals."""

    motion: MotionState | None
    windows: ObjectFileState


class RetinotopicModel(BindingModel):
    """Objects with places, also where they are alike in every feature.

    Args:
        config: constants.
        first_stage: weights of the three first-stage networks, trained (`FirstStage`) or `[10, 10]`; None for none.

    Shapes:
        frames `[..., T, C, H, W]` -> `RetinotopicSignals`, `RetinotopicState`.
    """

    name = "retinotopic"
    config_type = RetinotopicConfig
    learnable = ("tau_motion_high", "tau_motion_low")
    tracks = True
    config: RetinotopicConfig
    first_weights: Tensor

    def __init__(self, config: RetinotopicConfig | None = None, first_stage: FirstStage | Tensor | None = None) -> None:
        super().__init__()
        c = self.config = config or RetinotopicConfig()
        self.dt, self.settle = 1 / c.fps, 0.0
        self.eyes = LocalFeatures(c.fields.detectors(c.size, self.dt, c.border), c.fields.along)
        weights = torch.zeros(10, 10) if first_stage is None else first_stage_weights(first_stage)
        self.register_buffer("first_weights", weights)
        self.windows = ObjectFiles(self.eyes.grid, self.eyes.spacing, self.dt, c.border, c.tracking)

    @classmethod
    def build(cls, config: RetinotopicConfig, first_stage: Tensor | None) -> RetinotopicModel:
        return cls(config, first_stage)

    def first_stage(self) -> Tensor:
        return self.first_weights

    def check_own(self, state: Any) -> None:
        check_state(state, RetinotopicState)

    @without_autocast
    def forward(
        self, frames: Tensor, state: RetinotopicState | None = None
    ) -> tuple[RetinotopicSignals, RetinotopicState]:
        self.check_own(state)
        if state is not None and state.motion is None:
            raise InputError("state comes from from_fields and has no motion filters: go on with from_fields")
        fields, motion = self.eyes(frames_in(frames, self.dtype), state.motion if state is not None else None)
        signals, after = self.from_fields(fields, state)
        return signals, after._replace(motion=motion)

    @without_autocast
    def from_fields(
        self, fields: Tensor, state: RetinotopicState | None = None
    ) -> tuple[RetinotopicSignals, RetinotopicState]:
        """The model from the signals of its fields on, `[..., T, R, C, 10]`."""
        self.check_own(state)
        number, windows = self.windows(fields, state.windows if state is not None else None)
        outputs = fields @ settled(self.first_weights).to(fields.dtype).mT
        steps = fields.shape[-4]
        time = (torch.arange(steps, dtype=torch.float64) + (windows.steps - steps)) * self.dt
        motion = state.motion if state is not None else None
        return RetinotopicSignals(fields, outputs, number, time), RetinotopicState(motion, windows)

    def objects_batch(self, state: RetinotopicState) -> Nested:
        """The objects in view, those followed longest first; `track` is the number of the window."""
        self.check_own(state)
        w = state.windows
        there = self.windows.confirmed(w)
        owner, column = owner_column(w.covariance, self.first_weights)
        features = features_by_group(column, self.config.readout.smallest)
        parts = (there, features, owner, *self.windows.places(w), w.age, w.unseen)
        batch = w.age.shape[:-1]
        flat = [part.reshape(-1, *part.shape[len(batch) :]) for part in parts]
        now = (int(w.steps) - 1) * self.dt
        trials = list[list[BoundObject]]()
        for trial in zip(*flat, strict=True):
            found = list[BoundObject]()
            for k in trial[0].nonzero().flatten().tolist():
                row, index, place, velocity, age, unseen = (part[k].tolist() for part in trial[1:])
                kept = {name: value for name, value in zip(FEATURES, row, strict=True) if value > 0}
                thing = BoundObject(FEATURES[index], index, kept, tuple(place), tuple(velocity), track=k)
                found.append(replace(thing, first_seen=now - age, last_seen=now - unseen))
            trials.append(sorted(found, key=lambda thing: thing.first_seen or 0.0))
        return by_trial(trials, tuple(batch))

    def verdict(self, state: RetinotopicState) -> Nested:
        """`static` without any motion so far, `stable` when every object was followed for `tau_bind`."""
        self.check_own(state)
        w = state.windows
        confirmed = self.windows.confirmed(w)
        young = (confirmed & (w.age < self.config.tracking.tau_bind)).any(-1) | ~confirmed.any(-1)
        pairs = zip((w.peak <= 0).flatten().tolist(), young.flatten().tolist(), strict=True)
        words: list[Verdict] = ["static" if still else "learning" if new else "stable" for still, new in pairs]
        return by_trial(words, tuple(w.peak.shape))

    def weights(self, state: RetinotopicState) -> Tensor:
        """Of every window, `[..., K, 10, 10]`: the column of its owner, relative to the owner; zero elsewhere."""
        self.check_own(state)
        w = state.windows
        owner, column = owner_column(w.covariance, self.first_weights)
        at_owner = torch.nn.functional.one_hot(owner, 10).to(column.dtype)
        ratio = divide(column, column.gather(-1, owner.unsqueeze(-1)).expand_as(column))
        there = self.windows.confirmed(w)[..., None, None]
        return torch.where(there, (ratio * (1 - at_owner)).unsqueeze(-1) * at_owner.unsqueeze(-2), 0.0)


def owner_column(covariances: Tensor, first_stage: Tensor) -> tuple[Tensor, Tensor]:
    """The strongest neuron of single objects `[...]`, int64, and what fluctuates with it `[..., 10]`.

    Where one object dominates what is seen, it is known what the competitive rule converges to: the strongest neuron k
    owns it, and its column of weights is `<h_n h_k>`, h being the high-passed signals through the settled first stage,
    each group over its largest. So nothing has to be learned over again for every object that comes into view.

    Args:
        covariances: of high-passed signals, `[..., 10, 10]`.
        first_stage: weights `[10, 10]`.
    """
    scale = spread_groups(group_max(safe_sqrt(covariances.diagonal(dim1=-2, dim2=-1))))
    gain = settled(first_stage).to(covariances.dtype)
    shared = gain @ divide(covariances, scale.unsqueeze(-1) * scale.unsqueeze(-2)) @ gain.mT
    owner = shared.diagonal(dim1=-2, dim2=-1).argmax(-1)
    return owner, shared.gather(-1, owner[..., None, None].expand(*shared.shape[:-1], 1)).squeeze(-1)
