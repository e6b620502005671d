"""The scale-free model: networks settled at every step, a rule that takes weak and strong alike, owners and delays."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import torch
from pydantic import Field
from torch import Tensor, nn

from ndtorch.arguments import has_values
from ndtorch.binding.covariance import CovarianceState
from ndtorch.binding.first_stage import FirstStage
from ndtorch.binding.learning import NetworkState, settled, weight_change
from ndtorch.binding.models.base import Nested, by_trial
from ndtorch.binding.models.whole_field import BindingState, WholeFieldConfig, WholeFieldModel
from ndtorch.binding.network import InhibitoryNetwork
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.joint_diagonalisation import DELAYS, plain_table
from ndtorch.binding.readout.memory import AnswerMemory, count_confidence, each_confidence, no_answers, remember
from ndtorch.binding.readout.owners import OwnerCriteria, SourceCriteria, SumCriteria, owner_table, signal_statistics
from ndtorch.binding.readout.source_count import Bound, motion_residual, source_bound
from ndtorch.binding.readout.sums import Answer, SumState, SumStatistics, sums_table
from ndtorch.binding.rules import ScaleFreeRule
from ndtorch.config import Constants, Positive, constant
from ndtorch.utils.tensors import mapped
from ndtorch.vision.temporal import FilterState, LowPass


class RuleConstants(Constants):
    """Constants of the scale-free rule, and of what it sees."""

    gamma: float = constant(0.2, "learning rate in the long run, 1/s", ge=0)
    boost: float = constant(15.0, "how many times faster learning is at first, less one", ge=0)
    tau_boost: float = constant(4.0, "time constant with which that subsides", gt=0)
    tau_onset: float = constant(0.2, "soft start of learning", ge=0)
    tau_out: float = constant(2.0, "high-pass on the outputs in the learning rule", ge=0)
    tau_power: float = constant(3.0, "memory of the outputs' power", ge=0)
    exponent: float = constant(4.0, "of the gate between weak and strong outputs", gt=0)
    leak: float = constant(2.0, "how fast weights from weak to strong are forgotten, against gamma", ge=0)
    smallest_deviation: float = constant(0.02, "of an output, as a share of the largest", gt=0)
    lowest: float = constant(-0.4, "lowest and", le=0)
    highest: float = constant(1.2, "highest weight", ge=0)
    radius_limit: float = constant(0.95, "limit on the Perron root of the weights' magnitudes", gt=0, lt=1)

    def learning_rule(self) -> ScaleFreeRule:
        """The rule with these constants."""
        shared = self.model_dump(exclude={"tau_out", "tau_power", "smallest_deviation"})
        constants = {name: shared[name] for name in RuleConstants.model_fields if name in shared}
        return ScaleFreeRule(floor=self.smallest_deviation, **constants)


class ScaleFreeTable(RuleConstants):
    """Both stages run at the rate of the frames; the first one does not learn."""

    settle: float = constant(0.5, "time before the second stage learns", ge=0)
    every: float = constant(0.05, "time between changes of the weights", gt=0)
    tau_smooth: float = constant(0.05, "low-pass on the second stage's inputs", ge=0)


class OwnerReadout(SumCriteria, SourceCriteria, OwnerCriteria):
    """Objects from owners alone or, better, from delays of the sums; and what they are worth."""

    readout: Literal["owners", "sums"] = constant("sums", "from owners alone, or from delays of the sums")
    update: float = constant(0.1, "time between updates of all covariances", gt=0)
    tau_high: float = constant(2.0, "high-pass on their signals", ge=0)
    tau_owners: float = constant(5.0, "memory of those of inputs", gt=0)
    delays: tuple[Positive, ...] = constant(DELAYS, "delays of the others,", min_length=1)
    tau_recent: float = constant(0.75, "memory of what is still there,", gt=0)
    tau_fast: float = constant(3.5, "their short", gt=0)
    tau_slow: float = constant(12.0, "and long memory,", gt=0)
    pieces: int = constant(24, "which is of so many stretches of time,", gt=0)
    piece: float = constant(1.0, "each so long; as often objects are counted,", gt=0)
    tau_answers: float = constant(3.0, "and a number lasts until another has more votes in this memory", gt=0)
    stable_window: float = constant(1.0, "tau_s of the stability criterion", gt=0)
    stable_mean: float = constant(2.0, "time constant of the mean weights it looks at", ge=0)
    stable_change: float = constant(0.5, "S_thr of the stability criterion, weight per window", gt=0)
    certain: float = constant(0.9, "confidence of the number from which on it is stable", ge=0, le=1)


class ScaleFreeConfig(WholeFieldConfig):
    """Constants of the model."""

    model: Literal["scale-free"] = constant("scale-free", "kind of the model")
    network: ScaleFreeTable = Field(default_factory=ScaleFreeTable)
    readout: OwnerReadout = Field(default_factory=OwnerReadout)


class StageState(NamedTuple):
    """State of `ScaleFreeStage`: low-pass of the inputs `[..., 10]`, the states of its three parts, and its answers."""

    smooth: FilterState
    network: NetworkState
    statistics: CovarianceState
    sums: SumState
    answers: AnswerMemory

    @property
    def weights(self) -> Tensor:
        """T, `[..., 10, 10]`."""
        return self.network.weights

    @property
    def outputs(self) -> Tensor:
        """The latest outputs, `[..., 10]`."""
        return (settled(self.weights) @ self.smooth.low.unsqueeze(-1)).squeeze(-1)

    @property
    def steps(self) -> Tensor:
        """Time steps since the start."""
        return self.network.steps


class ScaleFreeStage(nn.Module):
    """Refined signals and sums -> outputs of the second stage, and a table of objects whenever asked for.

    Args:
        first_stage: weights of the first stage, `[10, 10]`, to tell light that changes everywhere from objects.
        dt: time step in seconds, that of the frames: nothing here needs a short one.
        network, readout: constants.

    Shapes:
        refined signals and sums `[..., T, 10]` -> outputs `[..., T, 10]`, `StageState`.
    """

    first_stage: Tensor

    def __init__(
        self,
        first_stage: Tensor,
        dt: float = 0.01,
        network: ScaleFreeTable | None = None,
        readout: OwnerReadout | None = None,
    ) -> None:
        super().__init__()
        n, r = network or ScaleFreeTable(), readout or OwnerReadout()
        self.dt, self.constants = dt, r
        self.period = max(1, round(r.piece / dt))
        self.smooth = LowPass(n.tau_smooth, dt, 1)
        self.network = InhibitoryNetwork(
            10,
            dt,
            n.learning_rule(),
            "settled",
            tau_in=math.inf,
            tau_out=n.tau_out,
            tau_power=n.tau_power,
            settle=n.settle,
            every=n.every,
            window=r.stable_window,
            tau_mean=r.stable_mean,
        )
        self.statistics = signal_statistics(dt, r.tau_owners, r.tau_high, r.update)
        taus = (r.tau_recent, r.tau_fast, r.tau_slow, r.tau_high)
        self.sums = SumStatistics(dt, r.delays, *taus, r.update, r.surprise, r.pieces, r.piece)
        self.register_buffer("first_stage", first_stage)

    def forward(self, refined: Tensor, sums: Tensor, state: StageState | None = None) -> tuple[Tensor, StageState]:
        if self.constants.readout == "owners" or not (has_values(refined) and has_values(sums)):
            # Programs and transforms cannot count: who reads their state does.
            return self.step(refined, sums, state)
        outputs, done = [], 0
        while done < refined.shape[-2]:
            steps = 0 if state is None else int(state.steps)
            upto = min(refined.shape[-2], done + self.period - steps % self.period)
            out, state = self.step(refined[..., done:upto, :], sums[..., done:upto, :], state)
            outputs.append(out)
            if int(state.steps) % self.period == 0:
                state = state._replace(answers=self.answered(state))
            done = upto
        assert state is not None
        return outputs[0] if len(outputs) == 1 else torch.cat(outputs, -2), state

    def step(self, refined: Tensor, sums: Tensor, state: StageState | None) -> tuple[Tensor, StageState]:
        """The same without answers."""
        smooth, low = self.smooth(refined, state.smooth if state is not None else None)
        outputs, network = self.network(smooth, state.network if state is not None else None)
        statistics = self.statistics(smooth, state.statistics if state is not None else None)
        kept = self.sums(sums, state.sums if state is not None else None)
        answers = no_answers(network.weights) if state is None else state.answers
        return outputs, StageState(low, network, statistics, kept, answers)

    def answered(self, state: StageState) -> AnswerMemory:
        """The memory of answers after one more, that of this moment."""
        state, r = mapped(state, lambda _, part: part.detach()), self.constants
        with torch.no_grad():
            bound = source_bound(state.sums.all, motion_residual(state.sums.products), r)
            # Answers from little are worth little.
            weight = (state.sums.products.age / r.tau_answers).clamp(0.03, 1).square()
            keep = math.exp(-r.piece / r.tau_answers)
            now = self.momentary(state, bound)
            margin = torch.where(now.doubt, 0.0, bound.margin)
            return remember(state.answers, now.table, margin, weight, state.steps, keep, now.changed)

    def momentary(self, state: StageState, bound: Bound) -> Answer:
        """The objects as of this moment alone."""
        r = self.constants
        table = owner_table(state.weights, state.statistics, r, dt=self.dt)
        return sums_table(
            table, state.weights, state.sums, self.first_stage, r, r, r.smallest, r.tau_slow, r.piece, bound
        )

    def known(self, state: StageState) -> AnswerMemory:
        """The memory of answers, with one of this moment where the latest is missing."""
        answers = state.answers
        late = int(state.steps) - int(answers.steps) >= self.period
        return self.answered(state) if late or not bool(answers.votes.any()) else answers

    def table(self, state: StageState) -> ObjectTable:
        """The objects, of one trial or a batch."""
        r = self.constants
        if r.readout == "owners":
            table = owner_table(state.weights, state.statistics, r, dt=self.dt)
            return plain_table(table, state.weights, self.first_stage, r)
        return self.known(state).table


class ScaleFreeModel(WholeFieldModel):
    """The model that holds on random scenes. It runs at the rate of the frames.

    Args:
        config: constants.
        first_stage: weights of the three first-stage networks, trained (`FirstStage`) or `[10, 10]`; None for none.
    """

    name = "scale-free"
    state_types = (BindingState, StageState)
    config_type = ScaleFreeConfig
    config: ScaleFreeConfig

    def __init__(self, config: ScaleFreeConfig | None = None, first_stage: FirstStage | Tensor | None = None) -> None:
        c = config or ScaleFreeConfig()
        # A settled network has no delay of one step that a long step could make unstable.
        super().__init__(c, first_stage, 1 / c.fps)
        self.second = ScaleFreeStage(self.first_weights, self.dt, c.network, c.readout)

    def refine(self, inputs: Tensor, state: None) -> tuple[Tensor, None]:
        return inputs @ settled(self.first_weights.to(inputs.dtype)).mT, None

    def bind(self, refined: Tensor, sums: Tensor, state: StageState | None) -> tuple[Tensor, StageState]:
        bound: tuple[Tensor, StageState] = self.second(refined, sums, state)
        return bound

    def table(self, state: BindingState) -> ObjectTable:
        """The objects, of one trial or a batch, whatever the verdict."""
        return self.second.table(state.second)

    def learned(self, state: BindingState) -> tuple[Tensor, Tensor]:
        """As in the contract: stable is a number of objects of a confidence of `certain` or more, from owners alone
        weights whose mean changes by at most `stable_change` per `stable_window`."""
        r, change = self.config.readout, weight_change(state.second.network)
        if r.readout == "owners":
            stable = change <= r.stable_change
        else:
            stable = count_confidence(self.second.known(state.second)) >= r.certain
        return torch.zeros_like(stable), stable

    def confidence(self, state: BindingState) -> Nested:
        """As in the contract; None from owners alone."""
        if self.config.readout.readout == "owners":
            return None
        sure = count_confidence(self.second.known(state.second))
        return by_trial([round(value, 3) for value in sure.flatten().tolist()], tuple(sure.shape))

    def object_confidence(self, state: BindingState) -> Tensor | None:
        return None if self.config.readout.readout == "owners" else each_confidence(self.second.known(state.second))
