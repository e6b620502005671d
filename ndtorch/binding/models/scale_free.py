"""The scale-free model: settled networks, a rule that takes weak and strong alike, and sources of the sums."""

from __future__ import annotations

from typing import Literal, NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from ndtorch.binding.first_stage import FirstStage
from ndtorch.binding.models.base import Nested, by_trial
from ndtorch.binding.models.whole_field import BindingState, WholeFieldConfig, WholeFieldModel
from ndtorch.binding.network import InhibitoryNetwork, NetworkState, settled
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.sources import SourceEstimator, SourceParams, SourceState
from ndtorch.binding.rules import ScaleFreeRule
from ndtorch.config import Constants, constant
from ndtorch.vision.temporal import FilterState, LowPass


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


class StageState(NamedTuple):
    """State of the second stage: low-pass of the inputs `[..., 10]`, network, and read-out."""

    smooth: FilterState
    network: NetworkState
    sources: SourceState

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


class ScaleFreeModel(WholeFieldModel):
    """The model that holds on random scenes. It runs at the rate of the frames.

    The network learns which signals go together; number and features of the objects are read from the sums, see
    `ndtorch.binding.readout.sources`.

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
        sources = self.sources(sums, state and state.sources)
        return outputs, StageState(low, network, sources)

    def table(self, state: BindingState) -> ObjectTable:
        """The objects, of one trial or a batch, whatever the verdict."""
        return self.sources.table(state.second.sources, state.second.weights)

    def learned(self, state: BindingState) -> tuple[Tensor, Tensor]:
        """As in the contract: stable is a number of objects of a confidence of `certain` or more."""
        stable = self.sources.confidence(state.second.sources) >= self.config.readout.certain
        return torch.zeros_like(stable), stable

    def confidence(self, state: BindingState) -> Nested:
        sure = self.sources.confidence(state.second.sources)
        return by_trial([round(value, 3) for value in sure.flatten().tolist()], tuple(sure.shape))

    def object_confidence(self, state: BindingState) -> Tensor | None:
        return self.sources.confidence(state.second.sources).unsqueeze(-1).expand(*state.second.weights.shape[:-1])
