"""The second stage with the scale-free rule: network and read-out in one module, each of its pieces of use alone."""

from __future__ import annotations

from typing import Literal, NamedTuple

from torch import Tensor, nn

from ndtorch.binding.feedback import settled
from ndtorch.binding.network import InhibitoryNetwork, NetworkState
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.delays import DelayState, DelayStatistics
from ndtorch.binding.readout.joined import refined_table
from ndtorch.binding.readout.owners import SignalStatistics, StatisticsState, owner_table
from ndtorch.binding.rules import ScaleFreeRule
from ndtorch.errors import InputError
from ndtorch.vision.temporal import FilterState, LowPass

Readout = Literal["owners", "delays"]
READOUTS: tuple[Readout, ...] = ("owners", "delays")


class StageState(NamedTuple):
    """State of `ScaleFreeStage`: low-pass of the inputs `[..., 10]`, and the states of its three parts."""

    smooth: FilterState
    network: NetworkState
    statistics: StatisticsState
    delays: DelayState

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
    """Refined signals -> outputs of the scale-free network, and a table of objects whenever asked for.

    Args:
        first_stage: weights of the first stage, `[10, 10]`, to tell light that changes everywhere from objects.
        dt: time step in seconds, that of the frames: nothing here needs a short one.
        rule: the learning rule.
        readout: "owners" reads the columns of T; "delays" also separates the signals by their delayed covariances.
        tau_smooth: low-pass on the network's inputs, seconds.
        settle: seconds before the network learns.
        window, tau_mean: of the change of the mean weights, see `InhibitoryNetwork`, seconds.

    Shapes:
        refined signals `[..., T, 10]` -> outputs `[..., T, 10]`, `StageState`.
    """

    first_stage: Tensor

    def __init__(
        self,
        first_stage: Tensor,
        dt: float = 0.01,
        rule: ScaleFreeRule | None = None,
        readout: Readout = "delays",
        tau_smooth: float = 0.05,
        settle: float = 0.5,
        window: float = 1.0,
        tau_mean: float = 2.0,
    ) -> None:
        super().__init__()
        if readout not in READOUTS:
            raise InputError(f"readout must be one of {', '.join(READOUTS)}, got {readout!r}")
        self.dt, self.readout = dt, readout
        self.smooth = LowPass(tau_smooth, dt, 1)
        self.network = InhibitoryNetwork.scale_free(10, dt, rule, settle=settle, window=window, tau_mean=tau_mean)
        self.statistics = SignalStatistics(dt)
        self.delays = DelayStatistics(dt)
        self.register_buffer("first_stage", first_stage, persistent=False)

    def forward(self, refined: Tensor, state: StageState | None = None) -> tuple[Tensor, StageState]:
        smooth, low = self.smooth(refined, state.smooth if state is not None else None)
        outputs, network = self.network(smooth, state.network if state is not None else None)
        statistics = self.statistics(smooth, state.statistics if state is not None else None)
        delays = self.delays(refined, state.delays if state is not None else None)
        return outputs, StageState(low, network, statistics, delays)

    def table(self, state: StageState) -> ObjectTable:
        """The objects at this moment, of one trial or a batch."""
        table = owner_table(state.weights, state.statistics, dt=self.dt)
        if self.readout == "owners":
            return table
        return refined_table(table, state.weights, state.delays, self.first_stage)
