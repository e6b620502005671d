"""What the two models of sums over the whole field share: frames or sums in, signals and a table of objects out."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from ndtorch.arguments import check_tensor
from ndtorch.binding.first_stage import FirstStage, first_stage_weights
from ndtorch.binding.models.base import BindingModel, Nested, Verdict, by_trial
from ndtorch.binding.normalise import BindingInputs, InputState, Order
from ndtorch.binding.objects import ObjectTable, bound_objects
from ndtorch.config import Constants, Deviations, ModelConfig, Size, constant
from ndtorch.errors import InputError
from ndtorch.vision.features import VisualFeatures
from ndtorch.vision.frames import frames_in
from ndtorch.vision.motion import Border, MotionState
from ndtorch.vision.temporal import Resample, ResampleState


class WholeField(Constants):
    """One receptive field, as wide as the frame."""

    tau_motion_high: float = constant(0.5, "High-pass of the motion detectors, seconds.", ge=0)
    tau_motion_low: float = constant(0.05, "Delay filter of the motion detectors, seconds.", ge=0)
    center: Deviations = constant(
        (19.0, 6.0), "Deviations of the center of the orientation filters along and across, pixels."
    )
    surround: Deviations = constant(
        (22.0, 9.0), "Deviations of the surround of the orientation filters along and across, pixels."
    )
    exact: bool = constant(False, "Orientation sums at full resolution: slower, differs by < 0.5 %.")


class Normalise(Constants):
    """From sums to inputs of the networks. [B §2.1.4]"""

    order: Order = constant(
        "filter-first", "High-pass before group normalisation (filter-first) or after it (printed)."
    )
    tau_sums: float = constant(1.0, "High-pass on the sums, seconds.", ge=0)
    window: float = constant(2.0, "Memory of the group normalisation, seconds.", gt=0)
    floor: float = constant(0.01, "Ratio of a group's level that counts as full fluctuation.", ge=0)


class WholeFieldConfig(ModelConfig):
    """What both configs say first."""

    size: Size = constant((500, 500), "Height and width of the frames, pixels.")
    fps: float = constant(100.0, "Frames a second.", gt=0, le=100_000)
    border: Border = constant("wrap", "Border: wrap for toroidal scenes, reflect for video.")
    fields: WholeField = Field(default_factory=WholeField, description="One field, as wide as the frame.")
    normalise: Normalise = Field(default_factory=Normalise)


class BindingSignals(NamedTuple):
    """What the model computed, one row per step of the networks.

    Attributes:
        sums: the ten spatial sums, `[..., T', 10]`.
        inputs: group-normalised inputs of the first stage.
        refined: outputs of the first stage.
        outputs: outputs of the second stage.
        scale: each group's recent maximum, n(t) of [C eq. 11].
        time: seconds since the first frame, `[T']`.
    """

    sums: Tensor
    inputs: Tensor
    refined: Tensor
    outputs: Tensor
    scale: Tensor
    time: Tensor


class BindingState(NamedTuple):
    """Everything that changes: nested tuples of tensors, see `ndtorch.binding.saving`.

    `motion` is None of a state that came from sums; `first` where the first stage is settled and has no state.
    """

    motion: MotionState | None
    resample: ResampleState
    inputs: InputState
    first: Any
    second: Any


class WholeFieldModel(BindingModel):
    """Frames -> ten wide-field signals -> three refining networks -> one binding network -> objects. [B, C]

    Shapes:
        frames `[..., T, C, H, W]` -> `BindingSignals` with T' rows, `BindingState`. `state=None` starts at rest,
        settled on the first frame. Chunks of any length give the same result.

    Raises:
        InputError: frames, weights or options that do not fit, with a message that says which.
    """

    config: Any

    def __init__(self, config: Any, first_stage: FirstStage | Tensor | None, dt: float) -> None:
        super().__init__()
        c = self.config = config
        self.dt, self.settle = dt, c.network.settle
        f, n = c.fields, c.normalise
        self.features = VisualFeatures(
            c.size, 1 / c.fps, f.tau_motion_high, f.tau_motion_low, c.border, f.exact, f.center, f.surround
        )
        self.resample = Resample(1 / c.fps, dt)
        self.inputs = BindingInputs(dt, n.order, n.tau_sums, n.window, n.floor)
        weights = torch.zeros(10, 10) if first_stage is None else first_stage_weights(first_stage)
        self.register_buffer("first_weights", weights)

    first_weights: Tensor

    @classmethod
    def build(cls, config: Any, first_stage: Tensor | None) -> Any:
        return cls(config, first_stage)  # type: ignore[call-arg]

    def first_stage(self) -> Tensor:
        return self.first_weights

    @abstractmethod
    def refine(self, inputs: Tensor, state: Any) -> tuple[Tensor, Any]:
        """The first stage: outputs `[..., T, 10]` and state."""

    @abstractmethod
    def bind(self, refined: Tensor, sums: Tensor, state: Any) -> tuple[Tensor, Any]:
        """The second stage: outputs `[..., T, 10]` and state, from refined signals and the sums they come from."""

    @abstractmethod
    def learned(self, state: BindingState) -> tuple[Tensor, Tensor]:
        """Of every trial, `[...]` bool: whether its outputs alternate, and whether its weights are stable if not."""

    def forward(self, frames: Tensor, state: BindingState | None = None) -> tuple[BindingSignals, BindingState]:
        if state is not None:
            self.check_own(state)
        if state is not None and state.motion is None:
            raise InputError("state comes from from_sums and has no motion filters: go on with from_sums")
        sums, motion = self.features(frames_in(frames, self.first_weights.dtype), state and state.motion)
        return self.scan(sums, motion, state)

    def from_sums(self, sums: Tensor, state: BindingState | None = None) -> tuple[BindingSignals, BindingState]:
        """The model from the ten spatial sums on, `[..., T, 10]`, one row a frame.

        For sums that were stored or superposed: many trials of many scenes make one batch.
        """
        if state is not None:
            self.check_own(state)
        check_tensor("sums", sums, half=False)
        if sums.ndim < 2 or sums.shape[-1] != 10 or sums.shape[-2] == 0:
            raise InputError(f"sums must be [..., T >= 1, 10], got {tuple(sums.shape)}")
        return self.scan(sums, state and state.motion, state)

    def scan(
        self, sums: Tensor, motion: MotionState | None, state: BindingState | None
    ) -> tuple[BindingSignals, BindingState]:
        """Sums -> inputs -> refined signals -> outputs; the filters of the frames are in the state `motion`."""
        sums, resample = self.resample.scan(sums, state and state.resample)
        if sums.shape[-2] == 0:
            assert state is not None
            empty = torch.zeros_like(sums)
            time = torch.zeros(0, dtype=torch.float64)
            return BindingSignals(sums, empty, empty, empty, empty, time), state._replace(
                motion=motion, resample=resample
            )
        (inputs, scale), input_state = self.inputs.scan(sums, state and state.inputs)
        refined, first = self.refine(inputs, state and state.first)
        outputs, second = self.bind(refined, sums, state and state.second)
        steps = sums.shape[-2]
        time = (torch.arange(steps, dtype=torch.float64) + (second.steps - steps)) * self.dt
        signals = BindingSignals(sums, inputs, refined, outputs, scale, time)
        return signals, BindingState(motion, resample, input_state, first, second)

    def verdict(self, state: BindingState) -> Nested:
        static = fluctuating_groups(state.inputs, self.config.normalise.floor) < 2
        alternating, stable = self.learned(state)
        words: list[Verdict] = []
        for still, flips, good in zip(
            static.flatten().tolist(), alternating.flatten().tolist(), stable.flatten().tolist(), strict=True
        ):
            words.append("static" if still else "alternating" if flips else "stable" if good else "learning")
        return by_trial(words, tuple(static.shape))

    def objects_batch(self, state: BindingState) -> Nested:
        """The objects in view; none while the verdict is `static` or `alternating`."""
        table, batch = self.table(state), tuple(state.second.weights.shape[:-2])
        static = fluctuating_groups(state.inputs, self.config.normalise.floor) < 2
        nothing = (static | self.learned(state)[0]).flatten().tolist()
        sure = self.object_confidence(state)
        each = [None] * len(nothing) if sure is None else list(sure.reshape(-1, 10))
        trials = zip(nothing, table.owners.reshape(-1, 10), table.rows.reshape(-1, 10, 10), each, strict=True)
        things = [[] if none else bound_objects(ObjectTable(owners, rows), c) for none, owners, rows, c in trials]
        return by_trial(things, batch)

    def object_confidence(self, state: BindingState) -> Tensor | None:
        """Probability of each neuron's object, `[..., 10]`; None of models that do not say."""
        return None

    def weights(self, state: BindingState) -> Tensor:
        weights: Tensor = state.second.weights
        return weights


def fluctuating_groups(state: InputState, floor: float) -> Tensor:
    """How many of the three groups fluctuated by more than `floor` of their level recently, `[...]`."""
    if state.sums.shape[-2] == 0:
        # A memory of a single step has nothing to compare: give every group the benefit of the doubt.
        return torch.full(state.sums.shape[:-2], state.sums.shape[-1])
    return (state.fluctuations.amax(-2) > floor * state.sums.amax(-2)).sum(-1)
