"""The recurrent network: one class for all networks of all models."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, Self

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_batch, check_number, check_state, check_tensor, is_whole
from ndtorch.binding.learning import (
    FEEDBACKS,
    Feedback,
    Moment,
    NetworkState,
    WhenFull,
    held,
    inhibit,
    latest_changes,
    through,
)
from ndtorch.binding.rules import Rule, ScaleFreeRule, learning_rule
from ndtorch.errors import InputError
from ndtorch.utils.backend import Backend, check_backend
from ndtorch.vision.blocks import BlockLowPass, Stretch
from ndtorch.vision.temporal import low_pass, low_pass_step, smoothing_factor

MOST_NEURONS = 8192
"""Their weights are N x N: 256 MiB in single precision."""


def learning(rule: Rule | str | None) -> Rule | None:
    """A rule or the rule of a name; None where it changes nothing."""
    rule = learning_rule(rule) if isinstance(rule, str) else rule
    if rule is not None and not all(hasattr(rule, name) for name in ("name", "learns", "rate", "change")):
        raise InputError(f"rule must be a learning rule, the name of one, or None, got {repr(rule)[:40]}")
    return rule if rule is not None and rule.learns else None


class InhibitoryNetwork(nn.Module):
    """Neurons that inhibit one another; the weights W are learned from common fluctuations. [B eq. 22-24]

    Delayed feedback is that of the papers, `o(t + dt) = i'(t) - W o(t)`; settled feedback is what this comes to rest
    at, `o = (I + W)^-1 i'`, at any time step. i' is the input high-passed with `tau_in`; the rule sees o' = outputs
    high-passed with `tau_out`. The weights change at every step where the feedback is delayed, else every `every`
    seconds.

    With `shared` weights, any number of fields have one W, learned from all of them at once: what is in the same place
    at the same time belongs together, even if it passes only once.

    Args:
        neurons: N, 2 to 8192.
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
        tau_rough: memory of what `alternation` looks at, seconds: long against a sample, short against learning.
        initial: weights to start from, `[N, N]`; None for zeros.
        backend: "numba" takes the steps by a kernel, "torch" by tensor operations, "auto" by a kernel where the
            network has one, no gradient is needed and the inputs are on a CPU.

    Shapes:
        inputs `[..., T, N]` -> outputs `[..., T, N]`, or `[..., T, F, N]` -> `[..., T, F, N]` with `shared` weights;
        state `NetworkState`, `None` starts at rest. Single or double precision.

    Raises:
        InputError: inputs of another width or precision, NaN or infinity in them, or options out of range.

    >>> network = InhibitoryNetwork(neurons=2, settle=0.0)
    >>> outputs, state = network(torch.rand(50, 2))
    >>> outputs.shape, state.weights.shape
    (torch.Size([50, 2]), torch.Size([2, 2]))
    """

    initial: Tensor | None

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
        tau_rough: float = 0.5,
        initial: Tensor | None = None,
        backend: Backend = "auto",
    ) -> None:
        super().__init__()
        if not (is_whole(neurons) and 2 <= neurons <= MOST_NEURONS):
            raise InputError(f"neurons must be a whole number from 2 to {MOST_NEURONS}, got {repr(neurons)[:40]}")
        check_number("dt", dt, above=0, unit="seconds")
        if feedback not in FEEDBACKS:
            raise InputError(f"feedback must be one of {', '.join(FEEDBACKS)}, got {feedback!r}")
        if when_full not in ("rescale", "stop"):
            raise InputError(f"when_full must be 'rescale' or 'stop', got {when_full!r}")
        if initial is not None:
            check_tensor("initial", initial)
        if initial is not None and initial.shape != (neurons, neurons):
            raise InputError(f"initial weights must be [{neurons}, {neurons}], got {tuple(initial.shape)}")
        if initial is not None and ((initial < 0).any() or initial.diagonal().any()):
            raise InputError("initial weights must not be negative, and zero on the diagonal")
        seconds = {"settle": settle, "window": window, "every": every}
        for name, value in {**seconds, "faint": faint}.items():
            check_number(name, value, least=0, unit="seconds" if name in seconds else "")
        if feedback == "delayed" and every > dt:
            raise InputError(f"with delayed feedback the weights change at every step of {dt} s, got every={every}")
        self.neurons, self.dt, self.shared, self.backend = neurons, dt, shared, check_backend(backend)
        self.a_in, self.a_rough = smoothing_factor(tau_in, dt, "tau_in"), smoothing_factor(tau_rough, dt, "tau_rough")
        self.every = max(1, round(every / dt))
        self.output_low = BlockLowPass(smoothing_factor(tau_out, dt, "tau_out"), self.every)
        self.mean_square = BlockLowPass(smoothing_factor(tau_power, dt, "tau_power"), self.every)
        self.feedback, self.settle, self.faint, self.when_full = feedback, settle, faint, when_full
        self.a_mean = smoothing_factor(tau_mean, dt * self.every, "tau_mean")
        self.rule, self.time = rule, -3 if shared else -2
        self.window_changes = max(1, round(window / (dt * self.every)))
        self.register_buffer("initial", initial)

    @property
    def rule(self) -> Rule | None:
        """The learning rule; None where the weights are fixed. A rule, or the name of one, can be assigned.

        Raises:
            InputError: what is assigned is neither.
        """
        return self._rule

    @rule.setter
    def rule(self, rule: Rule | str | None) -> None:
        self._rule = learning(rule)

    @classmethod
    def scale_free(cls, neurons: int = 10, dt: float = 0.01, rule: Rule | None = None, **options: Any) -> Self:
        """The network of the scale-free model: settled feedback, changes every 50 ms, inputs as they come."""
        constants = {"tau_in": math.inf, "tau_out": 2.0, "settle": 0.5, "every": 0.05, **options}
        return cls(neurons, dt, rule or ScaleFreeRule(), "settled", **constants)

    def extra_repr(self) -> str:
        return f"neurons={self.neurons}, feedback={self.feedback!r}, backend={self.backend!r}"

    def start(self, first: Tensor) -> NetworkState:
        """State at rest, its input filter settled on the first input `[..., N]`, or `[..., F, N]` of fields."""
        batch, n = first.shape[: -2 if self.shared else -1], self.neurons
        weights = first.new_zeros(*batch, n, n)
        if self.initial is not None:
            weights = weights + self.initial.to(first.dtype)
        # No tensor twice: an export would take the two for one for ever.
        return NetworkState(
            weights=weights,
            outputs=torch.zeros_like(first),
            input_low=torch.zeros_like(first) if self.a_in == 0 else first.clone(),
            output_low=torch.zeros_like(first),
            recent=first.new_zeros(*batch, self.every - 1, *first.shape[len(batch) :]),
            fluctuation=first.new_zeros(*batch, n),
            clock=first.new_zeros(batch, dtype=torch.float64),
            stopped=torch.zeros(batch, dtype=torch.bool, device=first.device),
            mean_weights=weights.clone(),
            changes=first.new_zeros(*batch, self.window_changes),
            power=torch.zeros_like(first),
            roughness=torch.zeros_like(first),
            steps=torch.zeros((), dtype=torch.int64),
        )

    def forward(self, inputs: Tensor, state: NetworkState | None = None) -> tuple[Tensor, NetworkState]:
        check_state(state, NetworkState)
        self._check(inputs)
        check_batch(state, inputs.shape[: self.time], "weights", "outputs")
        return self.scan(inputs, state)

    def scan(self, inputs: Tensor, state: NetworkState | None) -> tuple[Tensor, NetworkState]:
        """`forward` without checks, for models whose inputs are their own."""
        time = self.time
        state = self.start(inputs.select(time, 0)) if state is None else state
        drive, input_low = inputs, state.input_low
        if self.a_in:
            lows, input_low = low_pass(inputs, input_low, self.a_in, time)
            drive = inputs - lows
        outs, now = [], state
        shifts: list[tuple[Tensor, Tensor | None]] = []
        blocks: Sequence[Tensor]
        whole: Sequence[Tensor | None]
        compiled = torch.compiler.is_compiling()
        if self.feedback == "delayed":
            first = (state.steps if compiled else int(state.steps)) + 1
            blocks, whole = drive.unbind(time), [None] * inputs.shape[time]
        else:
            stretch = Stretch(state.recent, drive, state.steps, self.every, time)
            first, blocks, whole = stretch.first, stretch.blocks, stretch.whole
        ahead = self._moments(state, first, len(blocks), drive.select(time, 0)) if blocks else iter(())
        moment = next(ahead, None)
        for block, known in zip(blocks, whole, strict=True):
            out, after, shift = self._step(block, now, moment)
            if known is not None:
                # An exported program cannot skip a block that is not whole yet: it takes nothing from it.
                after = NetworkState(*(torch.where(known, a, b) for a, b in zip(after, now, strict=True)))
            # Asleep, the clock stands still.
            if not self.faint or after.clock is not now.clock:
                moment = next(ahead, None)
            now = after
            outs.append(out)
            if shift is not None:
                shifts.append((shift, known))
        if self.feedback == "delayed":
            out = torch.stack(outs, time)
        else:
            out = stretch.joined(outs, lambda rest: through(rest, now.weights, self.shared))
            now = now._replace(recent=stretch.recent)
        power, roughness = state.power, state.roughness
        if self.feedback == "delayed":  # settled networks cannot alternate
            power, roughness = self._diagnose(out, state, time)
        steps = state.steps + inputs.shape[time]
        return out, now._replace(
            outputs=out.select(time, -1),
            input_low=input_low,
            clock=now.clock if self.faint else torch.zeros_like(now.clock) + steps,
            changes=latest_changes(state.changes, shifts) if shifts else state.changes,
            power=power,
            roughness=roughness,
            steps=steps,
        )

    def _moments(self, state: NetworkState, first: int | Tensor, count: int, like: Tensor) -> Iterator[Moment]:
        """What depends on time alone, at every change of the weights to come; nothing where each has its own clock."""
        if self.rule is None or (self.faint and (torch.compiler.is_compiling() or state.clock.ndim)):
            return iter(())
        number = torch.arange(count, dtype=torch.float64, device=like.device) * self.every
        return self._at(number + (state.clock + self.every if self.faint else first), like)

    def _at(self, clock: Tensor, like: Tensor) -> Iterator[Moment]:
        """Moments at readings of the learning's clock, `[K, ...]`, for signals like `[..., N]`; one for each of K."""
        rule = self.rule
        assert rule is not None
        # Delayed: o(t + dt), which the rule sees at the time t.
        lag = 1 if self.feedback == "delayed" and not self.faint else 0
        seconds = (clock - lag) * self.dt - self.settle
        ready = [True] * len(clock) if torch.compiler.is_compiling() or clock.ndim > 1 else (seconds > 0).tolist()
        batch = like.ndim - (2 if self.shared else 1)
        rates = rule.rate(seconds if clock.ndim > 1 else seconds.reshape(-1, *[1] * batch))
        scale = (rates * (self.dt * self.every)).to(like.dtype)[..., None, None]
        apart = 1 - torch.eye(like.shape[-1], dtype=like.dtype, device=like.device)
        # Many networks with rates of their own: not all of their steps at once.
        factors = (
            (scale * apart).unbind(0) if scale.numel() == len(clock) else (part * apart for part in scale.unbind(0))
        )
        seen: list[Tensor | None] = [None] * len(clock)
        if rule.uses_power:
            keep = math.log1p(-self.mean_square.a) if self.mean_square.a < 1 else -math.inf
            seen = list((-torch.expm1(keep * clock)).to(like.dtype).unsqueeze(-1).unbind(0))
        for begun, factor, share in zip(ready, factors, seen, strict=True):
            yield Moment(factor if begun else None, share)

    def _step(
        self, block: Tensor, state: NetworkState, moment: Moment | None
    ) -> tuple[Tensor, NetworkState, Tensor | None]:
        """One step of the network, from one change of the weights to the next.

        Args:
            block: drive i', `[..., N]` for delayed feedback, a block `[..., E, N]` for settled; `[..., F, N]` and
                `[..., E, F, N]` of fields.
            state: before.
            moment: None where the clock is in the state.

        Returns:
            outputs like `block`, the state after, and the summed magnitude of the change of the mean weights, `[...]`,
            None if there was no change.
        """
        rule, weights = self.rule, state.weights
        outputs, fluctuation, clock = state.outputs, state.fluctuation, state.clock
        if self.feedback == "delayed":
            out = outputs = block - outputs @ weights.mT if self.shared else inhibit(block, weights, outputs)
        else:
            out = through(block, weights, self.shared)
        if rule is None:
            return out, state._replace(outputs=outputs), None
        high, low = self._fluctuations(out, state.output_low)
        compiled, awake, squares = torch.compiler.is_compiling(), None, None
        if self.faint:
            squares = high.square()
            awake = squares.mean(-1).flatten(clock.ndim).amax(-1) >= self.faint**2
            if not compiled and not awake.any():
                return out, state._replace(outputs=outputs, output_low=low), torch.zeros_like(clock, dtype=out.dtype)
            clock = clock + awake * self.every
            if moment is None:
                moment = next(self._at(clock.unsqueeze(0), out.select(self.time, 0)))
        assert moment is not None
        # Alone, it is awake here.
        awake = awake if compiled or clock.ndim else None
        if rule.uses_power:
            squares = high.square() if squares is None else squares
            kept, taken = self.mean_square.weights(high.select(-2, 0) if self.shared else high)
            fluctuation = held(
                awake, kept * fluctuation + taken @ (squares.sum(-2) if self.shared else squares), fluctuation
            )
        mean, stopped, shift = state.mean_weights, state.stopped, None
        if moment.factor is not None:
            power = fluctuation if moment.seen is None else fluctuation / moment.seen
            change = rule.change(high.flatten(-3, -2) if self.shared else high, power, weights, self.every)
            grown, full = rule.bounded(torch.addcmul(weights, change, moment.factor))
            learning = awake
            if compiled:
                begun = moment.factor.amax((-1, -2)) > 0
                learning = begun if awake is None else awake & begun
            if self.when_full == "stop":
                learning = ~stopped if learning is None else learning & ~stopped
                stopped = stopped if full is None else stopped | (full if awake is None else full & awake)
            weights = held(learning, grown, weights)
            step = (weights.detach() - mean) * self.a_mean
            step = held(awake, step, torch.zeros_like(step))
            mean, shift = mean + step, torch.linalg.vector_norm(step, 1, (-1, -2))
        # By position: `_replace` costs as much as three operations.
        end = NetworkState(
            weights, outputs, state.input_low, low, state.recent, fluctuation, clock, stopped, mean, *state[9:]
        )
        return out, end, shift

    def _fluctuations(self, out: Tensor, low: Tensor) -> tuple[Tensor, Tensor]:
        """High-passed outputs o' of one step, `[..., E, N]` or `[..., E, F, N]`, and the filter's state."""
        time = self.time
        if self.feedback == "delayed":
            low = low_pass_step(out, low, self.output_low.a)
            return (out - low).unsqueeze(time), low
        if self.every == 1:
            lows = low_pass_step(out, low.unsqueeze(time), self.output_low.a)
        else:
            lows = (
                self.output_low(out.flatten(-2), low.flatten(-2)).view_as(out)
                if self.shared
                else self.output_low(out, low)
            )
        return out - lows, lows.select(time, -1)

    def _check(self, inputs: Tensor) -> None:
        """Raise `InputError` for inputs that cannot be used."""
        shape = f"[..., T, {'F, ' if self.shared else ''}{self.neurons}]"
        check_tensor("inputs", inputs, half=False)
        if inputs.ndim < -self.time or inputs.shape[-1] != self.neurons:
            raise InputError(f"inputs must be {shape}, got {tuple(inputs.shape)}")
        if inputs.shape[self.time] == 0:
            raise InputError(f"inputs must hold at least one time step, got {tuple(inputs.shape)}")

    def _diagnose(self, out: Tensor, state: NetworkState, time: int) -> tuple[Tensor, Tensor]:
        """Running means of squared outputs and of squared differences of successive outputs."""
        out = out.detach()
        before = torch.cat([state.outputs.detach().unsqueeze(time), out.narrow(time, 0, out.shape[time] - 1)], time)
        mean = torch.cat([state.power, state.roughness], -1)
        _, mean = low_pass(torch.cat([out, out - before], -1).square(), mean, self.a_rough, time)
        return mean[..., : self.neurons], mean[..., self.neurons :]
