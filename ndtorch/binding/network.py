"""The recurrent inhibitory network: one class, used for all four networks of the model."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.binding.rules import LearningRule, learning_onset, learning_rule
from ndtorch.binding.spectrum import limit_spectral_radius
from ndtorch.errors import InputError
from ndtorch.vision.temporal import low_pass_step, smoothing_factor, time_dim

WhenFull = Literal["rescale", "stop"]


class NetworkState(NamedTuple):
    """Everything of the network that changes. Save it and the run can go on from there, bit for bit.

    Attributes:
        weights: inhibition from neuron k to neuron n, `[..., N, N]`, diagonal zero, never negative.
        outputs: the latest outputs, `[..., N]`.
        input_low: what the input high-pass has taken for the mean, `[..., N]`.
        output_low: the same for the outputs in the learning rule, `[..., N]`.
        stopped: networks whose learning has ended, `[...]`, bool.
        mean_weights: running temporal mean of the weights, `[..., N, N]`.
        changes: summed magnitude of the changes of that mean in each recent step, `[..., S]`, oldest first.
        power: recent mean of squared outputs, `[..., N]`.
        roughness: recent mean of squared differences of successive outputs, `[..., N]`.
        steps: time steps taken since the start, int64 scalar.
    """

    weights: Tensor
    outputs: Tensor
    input_low: Tensor
    output_low: Tensor
    stopped: Tensor
    mean_weights: Tensor
    changes: Tensor
    power: Tensor
    roughness: Tensor
    steps: Tensor


class InhibitoryNetwork(nn.Module):
    """`o(t + dt) = i'(t) - W o(t)`, learning W from common fluctuations of its outputs. [B eq. 22-24]

    i' is the input high-passed with `tau_in`; the rule sees o' = outputs high-passed with `tau_out`. After each
    change, negative weights become zero, and the spectral radius is kept below `radius_limit`: either by
    scaling the weights back ("rescale", the second stage) or by ending the learning of a network that reaches
    it ("stop", the first stage). `radius_limit=inf` leaves stability to fate.

    Args:
        neurons: N.
        dt: time step in seconds. It is also the delay of the inhibition.
        rule: learning rule.
        gamma: learning rate per second; a tensor `[...]` gives every network of the batch its own. 0: fixed.
        tau_in, tau_out: time constants of the two high-passes, seconds; `tau_in=inf` lets the input through.
        settle: seconds before learning starts, for filters to settle.
        tau_onset: soft start of learning, seconds.
        radius_limit: largest spectral radius allowed.
        when_full: what happens there.
        window: seconds over which `weight_change` sums, tau_s of [C eq. 5].
        tau_mean: time constant of the mean of the weights that `weight_change` looks at, seconds; 0 for the
            weights themselves.
        initial: weights to start from, `[N, N]`; None for zeros.

    Shapes:
        inputs `[..., T, N]` -> outputs `[..., T, N]`; state `NetworkState`, `None` starts at rest.

    Raises:
        InputError: inputs of another width, or options out of range.
    """

    initial: Tensor | None
    off_diagonal: Tensor

    def __init__(
        self,
        neurons: int,
        dt: float = 0.01,
        rule: LearningRule | None = None,
        gamma: float | Tensor = 0.5,
        tau_in: float = 1.0,
        tau_out: float = 0.5,
        settle: float = 4.0,
        tau_onset: float = 2.0,
        radius_limit: float = 0.95,
        when_full: WhenFull = "rescale",
        window: float = 1.0,
        tau_mean: float = 2.0,
        initial: Tensor | None = None,
    ) -> None:
        super().__init__()
        if neurons < 2:
            raise InputError(f"a network needs at least 2 neurons, got {neurons}")
        if when_full not in ("rescale", "stop"):
            raise InputError(f"when_full must be 'rescale' or 'stop', got {when_full!r}")
        if not radius_limit > 0:
            raise InputError(f"radius_limit must be positive, got {radius_limit}")
        if initial is not None and initial.shape != (neurons, neurons):
            raise InputError(f"initial weights must be [{neurons}, {neurons}], got {tuple(initial.shape)}")
        if initial is not None and ((initial < 0).any() or initial.diagonal().any()):
            raise InputError("initial weights must not be negative, and zero on the diagonal")
        rates = torch.as_tensor(gamma)
        if not (rates >= 0).all() or not torch.isfinite(rates).all():
            raise InputError(f"gamma must be a learning rate >= 0, got {gamma}")
        for name, value in (("settle", settle), ("tau_onset", tau_onset), ("window", window)):
            if not 0 <= value < math.inf:
                raise InputError(f"{name} must be a number of seconds >= 0, got {value}")
        self.neurons, self.dt = neurons, dt
        self.rule = rule or learning_rule("competitive")
        self.gamma = gamma
        self.learns = bool((rates != 0).any())
        self.a_in, self.a_out = smoothing_factor(tau_in, dt), smoothing_factor(tau_out, dt)
        # Alternation is judged over half a second: long against a sample, short against learning.
        self.a_rough = smoothing_factor(0.5, dt)
        self.a_mean = smoothing_factor(tau_mean, dt)
        self.settle, self.tau_onset = settle, tau_onset
        self.radius_limit, self.when_full = radius_limit, when_full
        self.window_steps = max(1, round(window / dt))
        self.register_buffer("initial", initial)
        self.register_buffer("off_diagonal", 1 - torch.eye(neurons))

    def start(self, first: Tensor) -> NetworkState:
        """State at rest, its input filter settled on the first input `[..., N]`."""
        batch, n = first.shape[:-1], self.neurons
        zeros = torch.zeros_like(first)
        weights = first.new_zeros(*batch, n, n)
        if self.initial is not None:
            weights = weights + self.initial.to(first.dtype)
        return NetworkState(
            weights=weights,
            outputs=zeros,
            input_low=zeros if self.a_in == 0 else first,
            output_low=zeros,
            stopped=torch.zeros(batch, dtype=torch.bool, device=first.device),
            mean_weights=weights,
            changes=first.new_zeros(*batch, self.window_steps),
            power=zeros,
            roughness=zeros,
            steps=torch.zeros((), dtype=torch.int64),
        )

    def forward(self, inputs: Tensor, state: NetworkState | None = None) -> tuple[Tensor, NetworkState]:
        time_dim(inputs, 1)
        if inputs.shape[-1] != self.neurons:
            raise InputError(f"inputs must be [..., T, {self.neurons}], got {tuple(inputs.shape)}")
        state = self.start(inputs[..., 0, :]) if state is None else state
        step = int(state.steps)
        drive, input_low = self._drive(inputs, state.input_low)
        weights, outputs, output_low, stopped = state.weights, state.outputs, state.output_low, state.stopped
        mean_weights = state.mean_weights
        mask = self.off_diagonal.to(inputs.dtype) * self._rate(inputs)
        trace, changes = [], []
        for x in drive.unbind(-2):
            outputs = inhibit(x, weights, outputs)
            trace.append(outputs)
            if self.learns:
                output_low = low_pass_step(outputs, output_low, self.a_out)
                mu = learning_onset(step * self.dt - self.settle, self.tau_onset)
                if mu > 0:
                    grown = torch.addcmul(weights, self.rule.change(outputs - output_low), mask, value=mu)
                    weights, stopped = self._limit(weights, grown.clamp_min(0), stopped)
                    shift = (weights.detach() - mean_weights) * self.a_mean
                    mean_weights = mean_weights + shift
                    changes.append(torch.linalg.vector_norm(shift, 1, (-1, -2)))
            step += 1
        out = torch.stack(trace, -2)
        power, roughness = self._diagnose(out, state)
        recent = torch.cat([state.changes, torch.stack(changes, -1)], -1) if changes else state.changes
        end = NetworkState(
            weights=weights,
            outputs=outputs,
            input_low=input_low,
            output_low=output_low,
            stopped=stopped,
            mean_weights=mean_weights,
            changes=recent[..., -self.window_steps :],
            power=power,
            roughness=roughness,
            steps=torch.tensor(step, dtype=torch.int64),
        )
        return out, end

    def _drive(self, inputs: Tensor, low: Tensor) -> tuple[Tensor, Tensor]:
        """High-passed inputs i' `[..., T, N]` and the filter's state."""
        if self.a_in == 0:
            return inputs, low
        lows = []
        for x in inputs.unbind(-2):
            low = low_pass_step(x, low, self.a_in)
            lows.append(low)
        return inputs - torch.stack(lows, -2), low

    def _diagnose(self, out: Tensor, state: NetworkState) -> tuple[Tensor, Tensor]:
        """Running means of squared outputs and of squared differences of successive outputs."""
        out = out.detach()
        before = torch.cat([state.outputs.detach().unsqueeze(-2), out[..., :-1, :]], -2)
        mean = torch.cat([state.power, state.roughness], -1)
        for square in torch.cat([out, out - before], -1).square().unbind(-2):
            mean = low_pass_step(square, mean, self.a_rough)
        return mean[..., : self.neurons], mean[..., self.neurons :]

    def _rate(self, inputs: Tensor) -> Tensor:
        """`gamma dt`, shaped to multiply weights."""
        gamma = torch.as_tensor(self.gamma, dtype=inputs.dtype, device=inputs.device)
        return (gamma * self.dt).reshape(*gamma.shape, 1, 1) if gamma.ndim else gamma * self.dt

    def _limit(self, old: Tensor, grown: Tensor, stopped: Tensor) -> tuple[Tensor, Tensor]:
        """Keep the spectral radius of the new weights under its limit; returns weights and who has stopped."""
        if not math.isfinite(self.radius_limit):
            return grown, stopped
        limited = limit_spectral_radius(grown, self.radius_limit)
        if self.when_full == "rescale":
            return limited, stopped
        weights = torch.where(stopped[..., None, None], old, limited)
        # The limit returns the very same weights where they were inside it.
        return weights, stopped if limited is grown else stopped | (limited != grown).any(-1).any(-1)


def inhibit(drive: Tensor, weights: Tensor, outputs: Tensor) -> Tensor:
    """One step of the network, `o(t + dt) = i'(t) - W o(t)`: `[..., N]`, `[..., N, N]`, `[..., N]`. [B eq. 22]"""
    if drive.ndim == 1 and weights.ndim == 2:
        return torch.addmv(drive, weights, outputs, alpha=-1)
    return drive - (weights @ outputs.unsqueeze(-1)).squeeze(-1)


def weight_change(state: NetworkState) -> Tensor:
    """Summed magnitude of the changes of all mean weights over the recent window, `[...]`. [C eq. 5]

    As printed, the sum is over the weights themselves; but weights ripple with the fluctuations they are learned
    from, the more the faster they learn, and it is their temporal mean that settles [B §3.4.1]. `tau_mean=0`
    gives the printed sum.
    """
    return state.changes.sum(-1)


def alternation(state: NetworkState) -> Tensor:
    """How much of the outputs' recent power flips sign from sample to sample, `[...]`, 0 to 1.

    For a pure alternation the squared difference of successive outputs is four times their power; for signals
    that are slow against the time step it is near zero.
    """
    return state.roughness.sum(-1) / (4 * state.power.sum(-1)).clamp_min(torch.finfo(state.power.dtype).tiny)
