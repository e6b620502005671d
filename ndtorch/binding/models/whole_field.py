"""The two models of sums over the whole field, published and scale-free: frames or sums in, signals and objects out."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from ndtorch.arguments import check_state, check_tensor, without_autocast
from ndtorch.binding.first_stage import FirstStage, first_stage_weights
from ndtorch.binding.labelled import signal_dataset
from ndtorch.binding.models.base import BindingModel, Nested, Verdict, by_trial
from ndtorch.binding.network import InhibitoryNetwork, NetworkState, alternation, settled, weight_change
from ndtorch.binding.normalise import BindingInputs, InputState, Order
from ndtorch.binding.objects import ObjectTable, bound_objects, object_table
from ndtorch.binding.rules import RULES, Rule, ScaleFreeRule, learning_rule
from ndtorch.binding.sources import SourceEstimator, SourceParams, SourceState
from ndtorch.config import Constants, Deviations, ModelConfig, constant
from ndtorch.errors import InputError
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.features import VisualFeatures
from ndtorch.vision.frames import frames_in
from ndtorch.vision.motion import Border, MotionState
from ndtorch.vision.temporal import Discretization, FilterState, LowPass, Resample, ResampleState


class WholeField(Constants):
    """One receptive field, as wide as the frame."""

    tau_motion_high: float = constant(0.5, "High-pass of the motion detectors, seconds.", ge=0)
    tau_motion_low: float = constant(0.05, "Delay filter of the motion detectors, seconds.", ge=0)
    discretization: Discretization = constant(
        "euler", "Filters of the motion detectors: euler (as published) or exact (1 - exp(-dt / tau))."
    )
    center: Deviations = constant(
        (19.0, 6.0), "Deviations of the center of the orientation filters along and across, pixels."
    )
    surround: Deviations = constant(
        (22.0, 9.0), "Deviations of the surround of the orientation filters along and across, pixels."
    )
    exact: bool = constant(False, "Orientation sums at full resolution: slower, differs by < 0.5 %.")

    def detectors(self, size: tuple[int, int], dt: float, border: Border) -> VisualFeatures:
        """The detectors with these constants."""
        taus, sigmas = (self.tau_motion_high, self.tau_motion_low), (self.center, self.surround)
        return VisualFeatures(size, dt, *taus, border, self.exact, *sigmas, discretization=self.discretization)


LEARNABLE_FIELD = ("tau_motion_high", "tau_motion_low", "center", "surround")
"""Keys of `WholeField` that may be parameters."""


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

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` with the dimensions time (s) and signal, and trial of a batch; needs `ndtorch[xarray]`.

        `signals.to_xarray().outputs.sel(signal="red").plot()`
        """
        signals = {name: getattr(self, name) for name in self._fields if name != "time"}
        return signal_dataset(self.time, signals, {"sums": "pixel", "scale": "pixel"})


@safe_state
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
    second_state: ClassVar[type]
    first_weights: Tensor

    def __init__(self, config: Any, first_stage: FirstStage | Tensor | None, dt: float) -> None:
        super().__init__()
        c = self.config = config
        self.dt, self.settle = dt, c.network.settle
        f, n = c.fields, c.normalise
        self.features = f.detectors(c.size, 1 / c.fps, c.border)
        self.resample = Resample(1 / c.fps, dt)
        self.inputs = BindingInputs(dt, n.order, n.tau_sums, n.window, n.floor)
        weights = torch.zeros(10, 10) if first_stage is None else first_stage_weights(first_stage)
        self.register_buffer("first_weights", weights)

    @classmethod
    def build(cls, config: Any, first_stage: Tensor | None) -> Any:
        return cls(config, first_stage)  # type: ignore[call-arg]

    def first_stage(self) -> Tensor:
        return self.first_weights

    def check_own(self, state: Any) -> None:
        check_state(state, BindingState)
        check_state(state and state.second, self.second_state)

    @without_autocast
    def forward(self, frames: Tensor, state: BindingState | None = None) -> tuple[BindingSignals, BindingState]:
        self.check_own(state)
        if state is not None and state.motion is None:
            raise InputError("state comes from from_sums and has no motion filters: go on with from_sums")
        sums, motion = self.features(frames_in(frames, self.first_weights.dtype), state and state.motion)
        return self.scan(sums, motion, state)

    @without_autocast
    def from_sums(self, sums: Tensor, state: BindingState | None = None) -> tuple[BindingSignals, BindingState]:
        """The model from the ten spatial sums on, `[..., T, 10]`, one row a frame.

        For sums that were stored or superposed: many trials of many scenes make one batch.
        """
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
        steps = sums.shape[-2]
        if steps == 0:
            assert state is not None
            empty, time = torch.zeros_like(sums), torch.zeros(0, dtype=torch.float64)
            return BindingSignals(sums, *4 * (empty,), time), state._replace(motion=motion, resample=resample)
        (inputs, scale), normalised = self.inputs.scan(sums, state and state.inputs)
        refined, first = self.refine(inputs, state and state.first)
        outputs, second = self.bind(refined, sums, state and state.second)
        time = (torch.arange(steps, dtype=torch.float64) + (resample.given - steps)) * self.dt
        signals = BindingSignals(sums, inputs, refined, outputs, scale, time)
        return signals, BindingState(motion, resample, normalised, first, second)

    @abstractmethod
    def refine(self, inputs: Tensor, state: Any) -> tuple[Tensor, Any]:
        """The first stage: outputs `[..., T, 10]` and state."""

    @abstractmethod
    def bind(self, refined: Tensor, sums: Tensor, state: Any) -> tuple[Tensor, Any]:
        """The second stage: outputs `[..., T, 10]` and state, from refined signals and the sums they come from."""

    @abstractmethod
    def learned(self, state: BindingState) -> tuple[Tensor, Tensor]:
        """Of every trial, `[...]` bool: whether its outputs alternate, and whether its weights are stable if not."""

    def sure(self, state: BindingState) -> Tensor | None:
        """Probability that the number of objects is right, `[...]`; None of models that do not say."""
        return None

    def static(self, state: BindingState) -> Tensor:
        """Whether fewer than two of the three groups fluctuated by more than `floor` of their level lately, `[...]`."""
        self.check_own(state)
        sums, fluctuations = state.inputs.sums, state.inputs.fluctuations
        if sums.shape[-2] == 0:
            # A memory of a single step has nothing to compare: give every group the benefit of the doubt.
            return torch.zeros(sums.shape[:-2], dtype=torch.bool)
        floor: float = self.config.normalise.floor
        return (fluctuations.amax(-2) > floor * sums.amax(-2)).sum(-1) < 2

    def verdict(self, state: BindingState) -> Nested:
        static = self.static(state)
        each = (part.flatten().tolist() for part in (static, *self.learned(state)))
        words: list[Verdict] = [
            "static" if still else "alternating" if flips else "stable" if good else "learning"
            for still, flips, good in zip(*each, strict=True)
        ]
        return by_trial(words, tuple(static.shape))

    def confidence(self, state: BindingState) -> Nested:
        self.check_own(state)
        sure = self.sure(state)
        return None if sure is None else by_trial([round(x, 3) for x in sure.flatten().tolist()], tuple(sure.shape))

    def objects_batch(self, state: BindingState) -> Nested:
        """The objects in view; none while the verdict is `static` or `alternating`."""
        nothing = (self.static(state) | self.learned(state)[0]).flatten().tolist()
        table, sure = self.table(state), self.sure(state)
        each = [None] * len(nothing) if sure is None else list(sure.flatten())
        trials = zip(nothing, table.owners.reshape(-1, 10), table.rows.reshape(-1, 10, 10), each, strict=True)
        things = [[] if none else bound_objects(ObjectTable(owners, rows), c) for none, owners, rows, c in trials]
        return by_trial(things, tuple(table.owners.shape[:-1]))

    def weights(self, state: BindingState) -> Tensor:
        self.check_own(state)
        weights: Tensor = state.second.weights
        return weights


class PublishedNetwork(Constants):
    """The four networks; the three of the first stage do not learn."""

    dt: float = constant(0.01, "Time step and shortest delay of the feedback, seconds.", gt=0)
    delay: float = constant(0.0, "Delay of the feedback in time steps of dt, one at least, seconds.", ge=0, le=10)
    rule: str = constant(
        "competitive", "Learning rule: competitive, cooperative, hebbian, or a name of your own in RULES."
    )
    f: str = constant("cube", "Expansive function of the rule.")
    g: str = constant("tanh-pi", "Compressive function of the rule.")
    gamma: float = constant(0.5, "Learning rate of the second stage, 1/s.", ge=0)
    tau_in: float = constant(1.0, "High-pass on the inputs of the second stage, seconds.", ge=0)
    tau_out: float = constant(0.5, "High-pass on the outputs in the learning rule, seconds.", ge=0)
    settle: float = constant(4.0, "Time before the second stage learns, seconds.", ge=0)
    tau_onset: float = constant(2.0, "Soft start of learning, seconds.", ge=0)
    radius_limit: float = constant(0.95, "Limit on the spectral radius of the second stage.", gt=0, lt=1)


class WeightReadout(Constants):
    """Objects from weights [C §4.1], and what they are worth."""

    smallest_weight: float = constant(1 / 3, "Ratio to the largest weight from which on a weight counts.", ge=0)
    smallest_column: float = constant(0.6, "Sum of such weights of a neuron that makes it an owner.", ge=0)
    learned_weight: float = constant(0.6, "Largest weight from which on a network has learned.", ge=0)
    stable_window: float = constant(1.0, "Window tau_s of the stability criterion, seconds.", gt=0)
    stable_mean: float = constant(2.0, "Time constant of the mean weights of the stability criterion, seconds.", ge=0)
    stable_change: float = constant(0.5, "Threshold S_thr of the stability criterion, weight per window.", gt=0)
    tau_alternation: float = constant(0.5, "Memory of the outputs' power and of its alternating part, seconds.", gt=0)
    # Smooth signals have 0.001, white noise 0.5, a locked network 0.96 and more.
    alternating: float = constant(0.25, "Ratio of alternating power that only the delay makes.", gt=0)


class PublishedConfig(WholeFieldConfig):
    """Constants of the model; the defaults are the published ones. [B §2; C §2, §4]"""

    model: Literal["published"] = constant("published", "Kind of the model.")
    network: PublishedNetwork = Field(default_factory=PublishedNetwork)
    readout: WeightReadout = Field(default_factory=WeightReadout)


class PublishedModel(WholeFieldModel):
    """The model of the dissertation. [B, C]

    The networks run at their own step of 10 ms, and signals of slower or faster video are interpolated. The second
    stage begins to learn after `settle` seconds.

    Args:
        config: constants.
        first_stage: weights of the three first-stage networks, trained (`FirstStage`) or `[10, 10]`; None for none.
    """

    name = "published"
    learnable = ("gamma", "tau_in", "tau_out", "tau_sums", *LEARNABLE_FIELD)
    second_state = NetworkState
    config_type = PublishedConfig
    config: PublishedConfig

    def __init__(self, config: PublishedConfig | None = None, first_stage: FirstStage | Tensor | None = None) -> None:
        c = config or PublishedConfig()
        super().__init__(c, first_stage, c.network.dt)
        # The inputs come high-passed. The three networks are one with weights inside the groups only.
        self.first = InhibitoryNetwork(
            10, self.dt, None, tau_in=float("inf"), initial=self.first_weights, delay=c.network.delay
        )
        self.second, self._given_rule = second_stage(c), ""

    def use_rule(self, rule: Rule) -> None:
        """Learn by a rule of your own, in place of the config's; its gamma may be `[...]`, one for every trial of a
        batch."""
        self.second.rule, self._given_rule = rule, rule.name

    def save(self, path: str | Path, overwrite: bool = False) -> None:
        """As in the contract.

        Raises:
            InputError: also for a rule that was given as an object, which the config does not have.
        """
        if self._given_rule:  # never a name that is taken
            name = "mine" if self._given_rule in RULES else self._given_rule
            raise InputError(
                f"the rule {self._given_rule!r} was given as an object, which no config.toml can name: register its "
                f"maker, ndtorch.binding.rules.RULES[{name!r}] = lambda f, g, **constants: ..., and say rule = {name!r}"
            )
        super().save(path, overwrite)

    def refine(self, inputs: Tensor, state: NetworkState | None) -> tuple[Tensor, NetworkState]:
        return self.first.scan(inputs, state)

    def bind(self, refined: Tensor, sums: Tensor, state: NetworkState | None) -> tuple[Tensor, NetworkState]:
        return self.second.scan(refined, state)

    def table(self, state: BindingState) -> ObjectTable:
        """The objects, of one trial or a batch, whatever the verdict. [C §4.1]

        None before any weight has reached `learned_weight`: the read-out divides by the largest weight, and makes a
        table of the noise of a network that has learned nothing.
        """
        r, weights = self.config.readout, self.weights(state)
        large = weights.amax((-1, -2), keepdim=True) >= r.learned_weight
        return object_table(torch.where(large, weights, 0.0), r.smallest_weight, r.smallest_column)

    def learned(self, state: BindingState) -> tuple[Tensor, Tensor]:
        """As in the contract.

        Stable are weights whose mean changes by at most `stable_change` per `stable_window` [C eq. 5] while one has
        grown far enough to silence another neuron.
        """
        r, second = self.config.readout, state.second
        # Written so that NaN never counts as stable.
        unchanged = weight_change(second) <= r.stable_change
        return ~(alternation(second) <= r.alternating), unchanged & (second.weights.amax((-1, -2)) >= r.learned_weight)


def second_stage(config: PublishedConfig, gamma: float | Tensor | None = None) -> InhibitoryNetwork:
    """The second stage of the published model, untrained.

    Args:
        gamma: learning rates `[...]` in place of the configuration's, one for every trial of a batch.
    """
    n, r = config.network, config.readout
    if n.rule == "scale-free":
        raise InputError("the rule scale-free has a model of its own: load('scale-free')")
    rate = n.gamma if gamma is None else gamma
    return InhibitoryNetwork(
        10,
        n.dt,
        rule=learning_rule(n.rule, f=n.f, g=n.g, gamma=rate, tau_onset=n.tau_onset, radius_limit=n.radius_limit),
        delay=n.delay,
        tau_in=n.tau_in,
        tau_out=n.tau_out,
        settle=n.settle,
        window=r.stable_window,
        tau_mean=r.stable_mean,
        tau_rough=r.tau_alternation,
    )


class ScaleFreeTable(Constants):
    """Both stages run at the rate of the frames; the first one does not learn."""

    gamma: float = constant(0.2, "Learning rate in the long run, 1/s.", ge=0)
    leak: float = constant(2.0, "Rate at which weights from weak to strong are forgotten, over gamma.", ge=0)
    radius_limit: float = constant(0.95, "Limit on the Perron root of the weights' magnitudes.", gt=0, lt=1)
    tau_out: float = constant(2.0, "High-pass on the outputs in the learning rule, seconds.", ge=0)
    tau_smooth: float = constant(0.05, "Low-pass on the inputs of the second stage, seconds.", ge=0)
    settle: float = constant(0.5, "Time before the second stage learns, seconds.", ge=0)


class ScaleFreeConfig(WholeFieldConfig):
    """Constants of the model."""

    model: Literal["scale-free"] = constant("scale-free", "Kind of the model.")
    network: ScaleFreeTable = Field(default_factory=ScaleFreeTable)
    readout: SourceParams = Field(default_factory=SourceParams)


@safe_state
class StageState(NamedTuple):
    """State of the second stage: low-pass of the inputs `[..., 10]`, network, and read-out."""

    smooth: FilterState
    network: NetworkState
    sources: SourceState

    @property
    def weights(self) -> Tensor:
        """T, `[..., 10, 10]`."""
        return self.network.weights


class ScaleFreeModel(WholeFieldModel):
    """The model that holds on random scenes. It runs at the rate of the frames.

    The network learns which signals go together; number and features of the objects are read from the sums, see
    `ndtorch.binding.sources`.

    Args:
        config: constants.
        first_stage: weights of the three first-stage networks, trained (`FirstStage`) or `[10, 10]`; None for none.
    """

    name = "scale-free"
    learnable = ("gamma", "leak", "tau_out", "tau_smooth", "tau_sums", *LEARNABLE_FIELD)
    second_state = StageState
    config_type = ScaleFreeConfig
    config: ScaleFreeConfig

    def __init__(self, config: ScaleFreeConfig | None = None, first_stage: FirstStage | Tensor | None = None) -> None:
        c = config or ScaleFreeConfig()
        # A settled network has no delay of one step that a long step could make unstable.
        super().__init__(c, first_stage, 1 / c.fps)
        n = c.network
        rule = ScaleFreeRule(gamma=n.gamma, leak=n.leak, radius_limit=n.radius_limit)
        self.smooth = LowPass(n.tau_smooth, self.dt, 1)
        self.second = InhibitoryNetwork.scale_free(10, self.dt, rule, tau_out=n.tau_out, settle=n.settle)
        self.sources = SourceEstimator(self.dt, self.first_weights, c.readout)

    def refine(self, inputs: Tensor, state: None) -> tuple[Tensor, None]:
        return inputs @ settled(self.first_weights.to(inputs.dtype)).mT, None

    def bind(self, refined: Tensor, sums: Tensor, state: StageState | None) -> tuple[Tensor, StageState]:
        smooth, low = self.smooth.scan(refined, state and state.smooth)
        outputs, network = self.second.scan(smooth, state and state.network)
        return outputs, StageState(low, network, self.sources(sums, state and state.sources))

    def table(self, state: BindingState) -> ObjectTable:
        """The objects, of one trial or a batch, whatever the verdict."""
        return self.sources.table(state.second.sources, self.weights(state))

    def learned(self, state: BindingState) -> tuple[Tensor, Tensor]:
        """As in the contract: stable is a number of objects of a confidence of `certain` or more."""
        stable = self.sure(state) >= self.config.readout.certain
        return torch.zeros_like(stable), stable

    def sure(self, state: BindingState) -> Tensor:
        return self.sources.confidence(state.second.sources)
