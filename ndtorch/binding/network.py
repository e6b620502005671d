"""The recurrent network: one class for all networks of all models."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import chain
from typing import Any, Literal, NamedTuple, Self

import torch
from torch import Tensor, nn

from ndtorch.binding.feedback import FEEDBACKS, Feedback, inhibit, through
from ndtorch.binding.rules import Rule, ScaleFreeRule, learning_rule
from ndtorch.errors import InputError
from ndtorch.vision.blocks import BlockLowPass, Stretch
from ndtorch.vision.temporal import low_pass_step, smoothing_factor

WhenFull = Literal["rescale", "stop"]

# Alternation is judged over half a second: long against a sample, short against learning.
TAU_ROUGH = 0.5


class NetworkState(NamedTuple):
    """Everything of the network that changes. Save it and the run can go on from there, bit for bit.

    Shapes are those of a network by itself; with `shared` weights, F fields have `[..., F, N]` for `[..., N]` in all
    but `fluctuation`.

    Attributes:
        weights: inhibition from neuron k to neuron n, `[..., N, N]`, diagonal zero.
        outputs: the latest outputs, `[..., N]`.
        input_low: what the input high-pass has taken for the mean, `[..., N]`.
        output_low: the same for the outputs in the learning rule, `[..., N]`.
        recent: the latest inputs since the last change of the weights and before, `[..., E - 1, N]`, oldest first.
        fluctuation: running mean of o'^2, summed over fields, `[..., N]`, if the rule looks at it.
        share: how much of that mean has been seen, `[...]`.
        learned: seconds that the clock of the learning has run, `[...]`, float64.
        stopped: networks whose learning has ended, `[...]`, bool.
        mean_weights: running temporal mean of the weights, `[..., N, N]`.
        changes: summed magnitude of the changes of that mean at each recent change, `[..., S]`, oldest first.
        power: recent mean of squared outputs, `[..., N]`.
        roughness: recent mean of squared differences of successive outputs, `[..., N]`.
        steps: time steps taken since the start, int64 scalar.
    """

    weights: Tensor
    outputs: Tensor
    input_low: Tensor
    output_low: Tensor
    recent: Tensor
    fluctuation: Tensor
    share: Tensor
    learned: Tensor
    stopped: Tensor
    mean_weights: Tensor
    changes: Tensor
    power: Tensor
    roughness: Tensor
    steps: Tensor


class InhibitoryNetwork(nn.Module):
    """Neurons that inhibit one another; the weights W are learned from common fluctuations. [B eq. 22-24]

    Delayed feedback is that of the papers, `o(t + dt) = i'(t) - W o(t)`; settled feedback is what this comes to rest
    at, `o = (I + W)^-1 i'`, at any time step. i' is the input high-passed with `tau_in`; the rule sees o' = outputs
    high-passed with `tau_out`. The weights change at every step where the feedback is delayed, else every `every`
    seconds.

    With `shared` weights, any number of fields have one W, learned from all of them at once: what is in the same place
    at the same time belongs together, even if it passes only once.

    Args:
        neurons: N.
        dt: time step in seconds. It is also the delay of delayed feedback.
        rule: learning rule, or its name; None for fixed weights.
        feedback: "delayed" or "settled".
        shared: one weight matrix for all fields.
        tau_in, tau_out: time constants of the two high-passes, seconds; `tau_in=inf` lets the input through.
        tau_power: memory of the power of the outputs' fluctuations, for rules that look at it, seconds.
        settle: seconds before learning starts, for filters to settle.
        every: seconds between changes of the weights with settled feedback; the rule takes the mean in between.
        faint: the clock of the learning stands still while the fluctuations of all features together, root mean square,
            are below this in every field, so that nothing is forgotten in quiet times, nor learned from noise; 0: it
            never does.
        when_full: what happens to a network that meets its rule's limit on the spectral radius: its weights are scaled
            back ("rescale", the second stage), or its learning ends as well ("stop", the first stage).
        window: seconds over which `weight_change` sums, tau_s of [C eq. 5].
        tau_mean: time constant of the mean of the weights that `weight_change` looks at, seconds; 0 for the
            weights themselves.
        initial: weights to start from, `[N, N]`; None for zeros.

    Shapes:
        inputs `[..., T, N]` -> outputs `[..., T, N]`, or `[..., T, F, N]` -> `[..., T, F, N]` with `shared` weights;
        state `NetworkState`, `None` starts at rest. Single or double precision.

    Raises:
        InputError: inputs of another width or precision, or options out of range.
    """

    initial: Tensor | None
    off_diagonal: Tensor

    def __init__(
        self,
        neurons: int = 10,
        dt: float = 0.01,
        rule: Rule | str | None = "competitive",
        feedback: Feedback = "delayed",
        shared: bool = False,
        tau_in: float = 1.0,
        tau_out: float = 0.5,
        tau_power: float = 3.0,
        settle: float = 4.0,
        every: float = 0.0,
        faint: float = 0.0,
        when_full: WhenFull = "rescale",
        window: float = 1.0,
        tau_mean: float = 2.0,
        initial: Tensor | None = None,
    ) -> None:
        super().__init__()
        if neurons < 2:
            raise InputError(f"a network needs at least 2 neurons, got {neurons}")
        if feedback not in FEEDBACKS:
            raise InputError(f"feedback must be one of {', '.join(FEEDBACKS)}, got {feedback!r}")
        if when_full not in ("rescale", "stop"):
            raise InputError(f"when_full must be 'rescale' or 'stop', got {when_full!r}")
        if initial is not None and initial.shape != (neurons, neurons):
            raise InputError(f"initial weights must be [{neurons}, {neurons}], got {tuple(initial.shape)}")
        if initial is not None and ((initial < 0).any() or initial.diagonal().any()):
            raise InputError("initial weights must not be negative, and zero on the diagonal")
        seconds = {"settle": settle, "window": window, "every": every}
        for name, value in {**seconds, "faint": faint}.items():
            if not 0 <= value < math.inf:
                raise InputError(f"{name} must be a number{' of seconds' if name in seconds else ''} >= 0, got {value}")
        if feedback == "delayed" and every > dt:
            raise InputError(f"with delayed feedback the weights change at every step of {dt} s, got every={every}")
        self.neurons, self.dt = neurons, dt
        self.a_in, self.a_rough = smoothing_factor(tau_in, dt), smoothing_factor(TAU_ROUGH, dt)
        rule = learning_rule(rule) if isinstance(rule, str) else rule
        self.rule = rule if rule is not None and rule.learns else None
        self.feedback, self.shared = feedback, shared
        self.every = max(1, round(every / dt))
        self.settle, self.faint, self.when_full = settle, faint, when_full
        self.a_mean = smoothing_factor(tau_mean, dt * self.every)
        self.output_low = BlockLowPass(smoothing_factor(tau_out, dt), self.every)
        self.mean_square = BlockLowPass(smoothing_factor(tau_power, dt), self.every)
        self.window_changes = max(1, round(window / (dt * self.every)))
        self.register_buffer("initial", initial)
        self.register_buffer("off_diagonal", 1 - torch.eye(neurons))

    @classmethod
    def scale_free(cls, neurons: int = 10, dt: float = 0.01, rule: Rule | None = None, **options: Any) -> Self:
        """The network of the scale-free model: settled feedback, changes every 50 ms, inputs as they come."""
        constants = {"tau_in": math.inf, "tau_out": 2.0, "settle": 0.5, "every": 0.05, **options}
        return cls(neurons, dt, rule or ScaleFreeRule(), "settled", **constants)

    @classmethod
    def of_fields(cls, neurons: int = 10, dt: float = 0.01, rule: Rule | None = None, **options: Any) -> Self:
        """The network of the video model: one for all fields, settled, its clock standing still in quiet times."""
        constants = {"tau_in": math.inf, "tau_out": 2.0, "settle": 0.0, "faint": 0.05, **options}
        return cls(neurons, dt, rule, "settled", shared=True, **constants)

    def start(self, first: Tensor) -> NetworkState:
        """State at rest, its input filter settled on the first input `[..., N]`, or `[..., F, N]` of fields."""
        batch, n = first.shape[: -2 if self.shared else -1], self.neurons
        zeros, power = torch.zeros_like(first), first.new_zeros(*batch, n)
        weights = first.new_zeros(*batch, n, n)
        if self.initial is not None:
            weights = weights + self.initial.to(first.dtype)
        return NetworkState(
            weights=weights,
            outputs=zeros,
            input_low=zeros if self.a_in == 0 else first,
            output_low=zeros,
            recent=first.new_zeros(*batch, self.every - 1, *first.shape[len(batch) :]),
            fluctuation=power,
            share=first.new_zeros(batch),
            learned=first.new_zeros(batch, dtype=torch.float64),
            stopped=torch.zeros(batch, dtype=torch.bool, device=first.device),
            mean_weights=weights,
            changes=first.new_zeros(*batch, self.window_changes),
            power=zeros,
            roughness=zeros,
            steps=torch.zeros((), dtype=torch.int64),
        )

    def forward(self, inputs: Tensor, state: NetworkState | None = None) -> tuple[Tensor, NetworkState]:
        time = self._check(inputs)
        state = self.start(inputs.select(time, 0)) if state is None else state
        drive, input_low = self._drive(inputs, state.input_low, time)
        outs, shifts, now = [], [], state
        if self.feedback == "delayed":
            first = state.steps if torch.compiler.is_compiling() else int(state.steps)
            # o(t + dt), which the rule sees at the time t.
            factors = self._factors(first, inputs.shape[time], 1, drive)
            for x, factor in zip(drive.unbind(time), factors, strict=True):
                out, now, shift = network_step(x, now, self, factor)
                outs.append(out)
                shifts.append(shift)
            out = torch.stack(outs, time)
        else:
            stretch = Stretch(state.recent, drive, state.steps, self.every, time)
            factors = self._factors(stretch.first, len(stretch.blocks), self.every, drive)
            for block, whole, factor in zip(stretch.blocks, stretch.whole, factors, strict=True):
                out, after, shift = network_step(block, now, self, factor)
                if whole is not None:
                    # An exported program cannot skip a block that is not whole yet: it takes nothing from it.
                    after = NetworkState(*(torch.where(whole, a, b) for a, b in zip(after, now, strict=True)))
                    shift = None if shift is None else torch.where(whole, shift, 0.0)
                now = after
                outs.append(out)
                shifts.append(shift)
            out = stretch.joined(outs, lambda rest: through(rest, now.weights, self.shared))
            now = now._replace(recent=stretch.recent)
        power, roughness = self._diagnose(out, state, time)
        made = [shift for shift in shifts if shift is not None]
        changes = torch.cat([state.changes, torch.stack(made, -1)], -1) if made else state.changes
        steps = state.steps + inputs.shape[time]
        return out, now._replace(
            outputs=out.select(time, -1),
            input_low=input_low,
            learned=now.learned if self.faint else torch.zeros_like(now.learned) + steps * self.dt,
            changes=changes[..., -self.window_changes :],
            power=power,
            roughness=roughness,
            steps=steps,
        )

    def _check(self, inputs: Tensor) -> int:
        """Index of the time dimension, counted from the end; `InputError` for inputs that cannot be used."""
        time = -3 if self.shared else -2
        shape = f"[..., T, {'F, ' if self.shared else ''}{self.neurons}]"
        if inputs.ndim < -time or inputs.shape[-1] != self.neurons:
            raise InputError(f"inputs must be {shape}, got {tuple(inputs.shape)}")
        if inputs.shape[time] == 0:
            raise InputError(f"inputs must hold at least one time step, got {tuple(inputs.shape)}")
        if inputs.dtype not in (torch.float32, torch.float64):
            raise InputError(f"inputs must be float32 or float64, got {inputs.dtype}")
        return time

    def _drive(self, inputs: Tensor, low: Tensor, time: int) -> tuple[Tensor, Tensor]:
        """High-passed inputs i' and the filter's state."""
        if self.a_in == 0:
            return inputs, low
        lows = []
        for x in inputs.unbind(time):
            low = low_pass_step(x, low, self.a_in)
            lows.append(low)
        return inputs - torch.stack(lows, time), low

    def _diagnose(self, out: Tensor, state: NetworkState, time: int) -> tuple[Tensor, Tensor]:
        """Running means of squared outputs and of squared differences of successive outputs."""
        if self.feedback == "settled":  # which cannot alternate
            return state.power, state.roughness
        out = out.detach()
        before = torch.cat([state.outputs.detach().unsqueeze(time), out.narrow(time, 0, out.shape[time] - 1)], time)
        mean = torch.cat([state.power, state.roughness], -1)
        for square in torch.cat([out, out - before], -1).square().unbind(time):
            mean = low_pass_step(square, mean, self.a_rough)
        return mean[..., : self.neurons], mean[..., self.neurons :]

    def _factors(self, first: int | Tensor, count: int, every: int, like: Tensor) -> Iterable[Tensor | None]:
        """`factor` at `count` changes of the weights, `every` so many steps from `first` on; None before learning."""
        if self.rule is None or self.faint:
            return [None] * count
        idle, number = 0, torch.arange(count, dtype=torch.float64)
        seconds = (number * every + first) * self.dt - self.settle
        if not torch.compiler.is_compiling():
            idle = int((seconds <= 0).sum())
            seconds = seconds[idle:]
        batch = like.ndim - (3 if self.shared else 2)
        rates = self.rule.rate(seconds.to(like.device).reshape(-1, *[1] * batch))
        if rates.numel() == len(rates):
            return chain([None] * idle, self.factor(rates.flatten(), like).unbind(0))
        # Many networks with rates of their own: not all of their steps at once.
        return chain([None] * idle, (self.factor(rate, like) for rate in rates.unbind(0)))

    def factor(self, rate: Tensor, like: Tensor) -> Tensor:
        """What the rule's change is multiplied by at a rate `[...]`: `rate dt`, zero on the diagonal, `[..., N, N]`."""
        scale = (rate * (self.dt * self.every)).to(like.dtype)
        return scale[..., None, None] * self.off_diagonal.to(like.dtype)


def network_step(
    block: Tensor, state: NetworkState, network: InhibitoryNetwork, factor: Tensor | None
) -> tuple[Tensor, NetworkState, Tensor | None]:
    """One step of the network, from one change of the weights to the next.

    Args:
        block: drive i', `[..., N]` for delayed feedback, a block `[..., E, N]` for settled; `[..., F, N]` and
            `[..., E, F, N]` of fields.
        state: before.
        network: its constants.
        factor: see `InhibitoryNetwork.factor`; None while nothing is learned, or where the clock decides.

    Returns:
        outputs like `block`, the state after, and the summed magnitude of the change of the mean weights, `[...]`, None
        if there was no change.
    """
    rule, shared, weights = network.rule, network.shared, state.weights
    outputs, fluctuation, share, learned = state.outputs, state.fluctuation, state.share, state.learned
    if network.feedback == "delayed":
        out = outputs = block - outputs @ weights.mT if shared else inhibit(block, weights, outputs)
    else:
        out = through(block, weights, shared)
    if rule is None:
        return out, state._replace(outputs=outputs), None
    high, low = fluctuations(out, state.output_low, network)
    compiled, awake = torch.compiler.is_compiling(), None
    if network.faint:
        awake = high.square().mean(-1).flatten(learned.ndim).amax(-1) >= network.faint**2
        if not compiled and not awake.any():
            return out, state._replace(outputs=outputs, output_low=low), torch.zeros_like(share)
        learned = learned + awake.double() * (network.dt * network.every)
        factor = network.factor(rule.rate(learned - network.settle), out)
    if rule.uses_power:
        squares = high.square().sum(-2) if shared else high.square()
        kept, taken = network.mean_square.weights(squares)
        fluctuation = held(awake, kept * fluctuation + taken @ squares, fluctuation)
        share = held(awake, kept * share + (1 - kept), share)
    mean, stopped, shift = state.mean_weights, state.stopped, None
    if factor is not None:
        # The running mean starts at zero: early on it has not seen its share yet.
        power = fluctuation / share.unsqueeze(-1) if rule.uses_power else fluctuation
        change = rule.change(high.flatten(-3, -2) if shared else high, power, weights, network.every)
        grown, full = rule.bounded(torch.addcmul(weights, change, factor))
        learning = awake
        if compiled:
            learning = factor.amax((-1, -2)) > 0 if awake is None else awake & (factor.amax((-1, -2)) > 0)
        if network.when_full == "stop":
            learning = ~stopped if learning is None else learning & ~stopped
            stopped = stopped if full is None else stopped | (full if awake is None else full & awake)
        weights = held(learning, grown, weights)
        step = (weights.detach() - mean) * network.a_mean
        mean, shift = mean + step, torch.linalg.vector_norm(step, 1, (-1, -2))
    end = state._replace(
        weights=weights,
        outputs=outputs,
        output_low=low,
        fluctuation=fluctuation,
        share=share,
        learned=learned,
        stopped=stopped,
        mean_weights=mean,
    )
    return out, end, shift


def fluctuations(out: Tensor, low: Tensor, network: InhibitoryNetwork) -> tuple[Tensor, Tensor]:
    """High-passed outputs o' of one step, `[..., E, N]` or `[..., E, F, N]`, and the filter's state."""
    filter, time = network.output_low, -3 if network.shared else -2
    if network.feedback == "delayed":
        low = low_pass_step(out, low, filter.a)
        return (out - low).unsqueeze(time), low
    lows = filter(out.flatten(-2), low.flatten(-2)).view_as(out) if network.shared else filter(out, low)
    return out - lows, lows.select(time, -1)


def held(where: Tensor | None, new: Tensor, old: Tensor) -> Tensor:
    """`new` for the networks `where` `[...]`, `old` for the others; None: all."""
    if where is None:
        return new
    return torch.where(where.reshape(where.shape + (1,) * (new.ndim - where.ndim)), new, old)


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
    that are slow against the time step it is near zero, and with settled feedback it is zero.
    """
    power, roughness = state.power, state.roughness
    over = tuple(range(state.stopped.ndim, power.ndim))
    return roughness.sum(over) / (4 * power.sum(over)).clamp_min(torch.finfo(power.dtype).tiny)
