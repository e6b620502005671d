"""The recurrent network: one class for all networks of all models, its state, and whether it has converged."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from typing import Any, Literal, NamedTuple, Self

import torch
from torch import Tensor, nn

from ndtorch.arguments import (
    Backend,
    FullPrecision,
    check_backend,
    check_batch,
    check_number,
    check_state,
    check_tensor,
    is_whole,
    without_autocast,
)
from ndtorch.binding.rules import Rule, ScaleFreeRule, learning_rule
from ndtorch.errors import InputError
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.temporal import Seconds, keep_time, low_pass, low_pass_step, ratio, smoothing_factor

Feedback = Literal["delayed", "settled"]
WhenFull = Literal["rescale", "stop"]
MOST_NEURONS = 8192
"""Their weights are N x N: 256 MiB in single precision."""


@safe_state
class NetworkState(NamedTuple):
    """Everything of the network that changes. Save it and the run can go on from there, bit for bit.

    Shapes are those of a network by itself; with `shared` weights, F fields have `[..., F, N]` for `[..., N]` in all
    but `fluctuation`.

    Attributes:
        weights: inhibition from neuron k to neuron n, `[..., N, N]`, diagonal zero.
        outputs: the latest outputs, `[..., N]`.
        input_low: what the input high-pass has taken for the mean, `[..., N]`.
        output_low: the same for the outputs in the learning rule, `[..., N]`.
        recent: the latest inputs since the last change of the weights and before, `[..., E - 1, N]`, oldest first; with
            delayed feedback the outputs that have not inhibited yet, but for the latest.
        fluctuation: running mean of o'^2, summed over fields, `[..., N]`, if the rule looks at it.
        clock: time steps that the clock of the learning has run, float64 scalar.
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
    clock: Tensor
    stopped: Tensor
    mean_weights: Tensor
    changes: Tensor
    power: Tensor
    roughness: Tensor
    steps: Tensor


def settled(weights: Tensor) -> Tensor:
    """The gain `(I + W)^-1`: what the network makes of a steady input, `[..., N, N]`. [C eq. 2]

    It is what `o(t + dt) = i - W o(t)` comes to rest at, so it needs no short time step. It exists: the spectral
    radius of |W| stays below 1, so -1 is no eigenvalue of W.
    """
    eye = torch.eye(weights.shape[-1], dtype=weights.dtype, device=weights.device)
    inverse: Tensor = torch.linalg.inv_ex(eye + weights)[0]
    return inverse


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


def low_pass_of_blocks(a: float | Tensor, steps: Tensor) -> tuple[Tensor, Tensor]:
    """Weights of a low-pass over a block at once: `l_j = (1 - a)^(j + 1) l + a sum_i (1 - a)^(j - i) x_i`.

    In double precision, and rounded where they are used: signals of either precision get all that they can hold.

    Returns:
        those of the state l, `[S, 1]`, and of the samples x, `[S, S]`.
    """
    late = (steps[:, None] - steps).clamp_min(0)
    return ((1 - a) ** (steps + 1)).unsqueeze(-1), (a * (1 - a) ** late).tril()


class InhibitoryNetwork(FullPrecision):
    """Neurons that inhibit one another; the weights W are learned from common fluctuations. [B eq. 22-24]

    Delayed feedback is that of the papers, `o(t + dt) = i'(t) - W o(t)`; settled feedback is what this comes to rest
    at, `o = (I + W)^-1 i'`, at any time step. With a `delay` tau_i of its own it is `o(t) = i'(t) - W o(t - tau_i)`
    [B eq. 18]. i' is the input high-passed with `tau_in`; the rule sees o' = outputs
    high-passed with `tau_out`. The weights change at every step where the feedback is delayed, else every `every`
    seconds.

    With `shared` weights, any number of fields have one W, learned from all of them at once: what is in the same place
    at the same time belongs together, even if it passes only once.

    Args:
        neurons: N, 2 to 8192.
        dt: time step in seconds, and the delay of delayed feedback where that is not longer.
        rule: learning rule, or its name; None for fixed weights.
        feedback: "delayed" or "settled".
        delay: seconds until outputs inhibit, rounded to time steps, one at least.
        shared: one weight matrix for all fields.
        tau_in, tau_out: time constants of the two high-passes, seconds; as `torch.nn.Parameter` they are learned;
            `tau_in=inf` lets the input through.
        tau_power: memory of the power of the outputs' fluctuations, for rules that look at it, seconds.
        settle: seconds before learning starts, for filters to settle.
        every: seconds between changes of the weights with settled feedback; the rule takes the mean in between.
        faint: the clock of the learning stands still while the fluctuations of all features together, root mean square,
            are below this in every field, so that nothing is forgotten in quiet times, nor learned from noise; 0: it
            never does. For settled feedback, one trial at a time, and not in exported programs.
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
    dt: float
    tau_in: Seconds
    tau_out: Seconds
    tau_rough: float
    decay: Tensor
    lagged: Tensor
    power_shares: Tensor

    def __init__(
        self,
        neurons: int = 10,
        dt: float = 0.01,
        rule: Rule | str | None = "competitive",
        feedback: Feedback = "delayed",
        shared: bool = False,
        delay: float = 0.0,
        tau_in: Seconds = 1.0,
        tau_out: Seconds = 0.5,
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
        if feedback not in ("delayed", "settled"):
            raise InputError(f"feedback must be 'delayed' or 'settled', got {feedback!r}")
        if when_full not in ("rescale", "stop"):
            raise InputError(f"when_full must be 'rescale' or 'stop', got {when_full!r}")
        if initial is not None:
            check_tensor("initial", initial)
            if initial.shape != (neurons, neurons):
                raise InputError(f"initial weights must be [{neurons}, {neurons}], got {tuple(initial.shape)}")
            if (initial < 0).any() or initial.diagonal().any():
                raise InputError("initial weights must not be negative, and zero on the diagonal")
        for name, value in {"settle": settle, "window": window, "every": every, "faint": faint, "delay": delay}.items():
            check_number(name, value, least=0, unit="" if name == "faint" else "seconds")
        if feedback == "delayed" and (every > dt or faint):
            raise InputError(f"delayed feedback changes its weights at every step, got every={every}, faint={faint}")
        if feedback == "settled" and delay:
            raise InputError(f"settled feedback has no delay, got delay={delay}")
        self.lag = max(1, round(delay / dt))
        self.neurons, self.shared, self.backend = neurons, shared, check_backend(backend)
        self.feedback, self.settle, self.faint, self.when_full = feedback, settle, faint, when_full
        self.every, self.rule, self.time = max(1, round(every / dt)), rule, -3 if shared else -2
        keep_time(self, dt=dt, tau_in=tau_in, tau_rough=tau_rough, tau_out=tau_out)
        self.filters_input = isinstance(tau_in, Tensor) or tau_in != math.inf
        self.a_power = smoothing_factor(tau_power, dt, "tau_power")
        self.a_mean = smoothing_factor(tau_mean, dt * self.every, "tau_mean")
        self.window_changes = max(1, round(window / (dt * self.every)))
        self.register_buffer("initial", initial)
        steps = torch.arange(self.every, dtype=torch.float64)
        if not isinstance(tau_out, Tensor):
            decay, lagged = low_pass_of_blocks(self.a_out, steps)
            self.register_buffer("decay", decay)
            self.register_buffer("lagged", lagged)
        self.register_buffer("power_shares", self.a_power * (1 - self.a_power) ** steps.flip(0))

    @property
    def a_out(self) -> float | Tensor:
        """Ratio of an output that the mean of the outputs takes in at each step."""
        return ratio(self.tau_out, self.dt)

    @property
    def rule(self) -> Rule | None:
        """The learning rule; None where the weights are fixed. A rule, or the name of one, can be assigned.

        Raises:
            InputError: what is assigned is neither.
        """
        if not self._learned:
            return self._rule
        rule = copy.copy(self._rule)
        for name in self._learned:
            object.__setattr__(rule, name, self.rule_constants[name])
        return rule

    @rule.setter
    def rule(self, rule: Rule | str | None) -> None:
        rule = learning_rule(rule) if isinstance(rule, str) else rule
        if rule is not None and not all(hasattr(rule, name) for name in ("name", "learns", "rate", "change")):
            raise InputError(f"rule must be a learning rule, the name of one, or None, got {repr(rule)[:40]}")
        self._rule = rule if rule is not None and rule.learns else None
        # A rule that is a module has its parameters itself.
        own = {} if self._rule is None or isinstance(rule, nn.Module) else getattr(rule, "__dict__", {})
        self.rule_constants = nn.ParameterDict({k: v for k, v in own.items() if isinstance(v, nn.Parameter)})
        self._learned = tuple(self.rule_constants)

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
            input_low=first.clone() if self.filters_input else torch.zeros_like(first),
            output_low=torch.zeros_like(first),
            recent=first.new_zeros(*batch, max(self.every, self.lag) - 1, *first.shape[len(batch) :]),
            fluctuation=first.new_zeros(*batch, n),
            clock=torch.zeros((), dtype=torch.float64, device=first.device),
            stopped=torch.zeros(batch, dtype=torch.bool, device=first.device),
            mean_weights=weights.clone(),
            changes=first.new_zeros(*batch, self.window_changes),
            power=torch.zeros_like(first),
            roughness=torch.zeros_like(first),
            steps=torch.zeros((), dtype=torch.int64),
        )

    @without_autocast
    def forward(self, inputs: Tensor, state: NetworkState | None = None) -> tuple[Tensor, NetworkState]:
        check_state(state, NetworkState)
        shape = f"[..., T, {'F, ' if self.shared else ''}{self.neurons}]"
        check_tensor("inputs", inputs, half=False)
        if inputs.ndim < -self.time or inputs.shape[-1] != self.neurons:
            raise InputError(f"inputs must be {shape}, got {tuple(inputs.shape)}")
        if inputs.shape[self.time] == 0:
            raise InputError(f"inputs must hold at least one time step, got {tuple(inputs.shape)}")
        if self.faint and inputs.ndim > -self.time:
            raise InputError(f"inputs must be of one trial where faint > 0, got {tuple(inputs.shape)}")
        check_batch(state, inputs.shape[: self.time], "weights", "outputs")
        return self.scan(inputs, state)

    def scan(self, inputs: Tensor, state: NetworkState | None) -> tuple[Tensor, NetworkState]:
        """`forward` without checks, for models whose inputs are their own."""
        time = self.time
        state = self.start(inputs.select(time, 0)) if state is None else state
        drive, input_low = inputs, state.input_low
        if self.filters_input:
            drive, input_low = low_pass(inputs, input_low, self.tau_in, self.dt, time, blocks=False, high=True)
        delayed = self.feedback == "delayed"
        out, after, shifts = self._delayed(drive, state) if delayed else self._settled(drive, state)
        power, roughness, changes = state.power, state.roughness, state.changes
        if delayed:  # settled networks cannot alternate
            own = out.detach()
            before = torch.cat([state.outputs.detach().unsqueeze(time), own.narrow(time, 0, own.shape[time] - 1)], time)
            squares, mean = torch.cat([own, own - before], -1).square(), torch.cat([power, roughness], -1)
            _, mean = low_pass(squares, mean, self.tau_rough, self.dt, time, blocks=False)
            power, roughness = mean[..., : self.neurons], mean[..., self.neurons :]
        for shift, known in shifts if torch.compiler.is_compiling() else ():
            later = torch.cat([changes[..., 1:], shift.unsqueeze(-1)], -1)
            changes = later if known is None else torch.where(known, later, changes)
        if shifts and not torch.compiler.is_compiling():
            changes = torch.cat([changes, *(shift.unsqueeze(-1) for shift, _ in shifts)], -1)
        steps = state.steps + inputs.shape[time]
        return out, after._replace(
            outputs=out.select(time, -1),
            input_low=input_low,
            clock=after.clock if self.faint else torch.zeros_like(after.clock) + steps,
            changes=changes[..., changes.shape[-1] - self.window_changes :],
            power=power,
            roughness=roughness,
            steps=steps,
        )

    def _delayed(self, drive: Tensor, state: NetworkState) -> tuple[Tensor, NetworkState, list[Any]]:
        """`o(t + dt) = i'(t) - W o(t)` [B eq. 22], and a change of the weights at every step.

        Returns:
            outputs like `drive` `[..., T, N]`, or `[..., T, F, N]` of fields; the state after; and of every change the
            summed magnitude of that of the mean weights, `[...]`, and whether it was one, None for yes.
        """
        outs, shifts, time, lag = list[Tensor](), list[Any](), self.time, self.lag
        # An exported program cannot take a tensor of no steps apart.
        past = [*(state.recent.unbind(time) if self.lag > 1 else ()), state.outputs]
        for sample, timing in zip(drive.unbind(time), self._timings(state.steps, drive), strict=True):
            weights, before = state.weights, past[-lag]
            if self.shared:
                out = sample - before @ weights.mT
            elif sample.ndim == 1:
                out = torch.addmv(sample, weights, before, alpha=-1)
            else:
                out = sample - (weights @ before.unsqueeze(-1)).squeeze(-1)
            outs.append(out)
            past.append(out)
            if self.rule is None:
                state = state._replace(outputs=out)
                continue
            low = low_pass_step(out, state.output_low, self.a_out)
            state, shift = self._learn((out - low).unsqueeze(time), low, out, state, timing)
            if shift is not None:
                shifts.append((shift, None))
        recent = torch.stack(past[-lag:-1], time) if lag > 1 else state.recent
        return torch.stack(outs, time), state._replace(recent=recent), shifts

    def _settled(self, drive: Tensor, state: NetworkState) -> tuple[Tensor, NetworkState, list[Any]]:
        """`o = (I + W)^-1 i'` [C eq. 2], and a change of the weights after every block of `every` steps, counted from
        the start of the run. Returns the same as `_delayed`.

        An exported program does not know where in a block its samples begin: there, every step is tried as the end of
        a block, and keeps the state before if it is none.
        """
        given, time, every, compiled = drive.shape[self.time], self.time, self.every, torch.compiler.is_compiling()
        samples = torch.cat([state.recent, drive], time) if every > 1 else drive
        begun = 0 if compiled else int(state.steps) % every
        ends = range(1, given + 1) if compiled else range(every - begun, given + 1, every)
        outs, shifts, done, steps = list[Tensor](), list[Any](), 0, state.steps
        if isinstance(self.tau_out, Tensor):
            decay, lagged = low_pass_of_blocks(
                self.a_out, torch.arange(every, dtype=torch.float64, device=drive.device)
            )
        else:
            decay, lagged = self.decay, self.lagged
        ahead = self._timings(steps, drive, ends) if ends and not self.faint else None
        for end in ends:
            block = samples.narrow(time, end - 1, every).contiguous()
            out = self._through(block, state.weights)
            new = min(every, end - done)
            outs.append(out.narrow(time, every - new, new))
            if self.rule is not None:
                if every == 1:
                    lows = low_pass_step(out, state.output_low.unsqueeze(time), self.a_out)
                else:
                    flat = lagged.to(out.dtype) @ (out.flatten(-2) if self.shared else out)
                    low = state.output_low.flatten(-2) if self.shared else state.output_low
                    lows = (flat + decay.to(out.dtype) * low.unsqueeze(-2)).view_as(out)
                after, shift = self._learn(
                    out - lows, lows.select(time, -1), state.outputs, state, ahead and next(ahead)
                )
                known = (steps + end) % every == 0 if compiled and every > 1 else None
                if known is not None:
                    known = known.to(out.device)
                    after = NetworkState(*(torch.where(known, a, b) for a, b in zip(after, state, strict=True)))
                state = after
                if shift is not None:
                    shifts.append((shift, known))
            done = end
        if done < given:
            outs.append(self._through(drive.narrow(time, done, given - done), state.weights))
        recent = samples.narrow(time, given, every - 1)
        return torch.cat(outs, time), state._replace(recent=recent), shifts

    def _through(self, block: Tensor, weights: Tensor) -> Tensor:
        """Settled outputs of inputs `[..., E, N]`, or `[..., E, F, N]` of fields that share the weights."""
        gain = settled(weights).mT
        return block @ (gain.unsqueeze(-3) if self.shared and gain.ndim > 2 else gain)

    def _timings(
        self, clock: Tensor, like: Tensor, ends: range | None = None
    ) -> Iterator[tuple[Tensor | None, Tensor | None]]:
        """What depends on the time alone, of changes of the weights after so many steps more; default: after each.

        Yields:
            what the rule's change is multiplied by, `rate dt`, zero on the diagonal, `[..., N, N]`, None before
            learning begins; and how much the running mean of the power has taken in, for it starts at zero, None
            where it is not kept.
        """
        ends = range(1, like.shape[self.time] + 1) if ends is None else ends
        rule, compiled = self.rule, torch.compiler.is_compiling()
        if rule is None or not len(ends):
            yield from [(None, None)] * len(ends)
            return
        readings = torch.arange(ends.start, ends.stop, ends.step, dtype=torch.float64, device=like.device)
        readings = readings + (clock if compiled or self.faint else int(clock))
        # Delayed: o(t + dt), which the rule sees at the time t.
        seconds = (readings - int(self.feedback == "delayed")) * self.dt - self.settle
        begun = [True] * len(ends) if compiled else (seconds > 0).tolist()
        rates = rule.rate(seconds.reshape(-1, *[1] * (like.ndim + self.time)))
        scale = (rates * (self.dt * self.every)).to(like.dtype)[..., None, None]
        apart = 1 - torch.eye(self.neurons, dtype=like.dtype, device=like.device)
        taken: list[Tensor | None] = [None] * len(ends)
        if rule.uses_power:
            keep = math.log1p(-self.a_power) if self.a_power < 1 else -math.inf
            taken = list((-torch.expm1(keep * readings)).to(like.dtype).unsqueeze(-1).unbind(0))
        for learns, part, share in zip(begun, scale.unbind(0), taken, strict=True):
            yield part * apart if learns else None, share

    def _learn(
        self, high: Tensor, low: Tensor, outputs: Tensor, state: NetworkState, timing: Any
    ) -> tuple[NetworkState, Tensor | None]:
        """Change the weights by the fluctuations o' `[..., E, N]`, or `[..., E, F, N]` of fields.

        Args:
            low: state of their high-pass.
            outputs: for the state after.
            timing: of `_timings`; None where the clock is in the state.

        Returns:
            the state after, and the summed magnitude of the change of the mean weights, `[...]`, None without a change.
        """
        rule, weights, clock, fluctuation = self.rule, state.weights, state.clock, state.fluctuation
        assert rule is not None
        if self.faint:
            if not high.square().mean(-1).amax() >= self.faint**2:
                return state._replace(output_low=low), torch.zeros((), dtype=high.dtype, device=high.device)
            clock = clock + self.every
            timing = next(self._timings(clock, high, range(1)))
        factor, taken = timing
        if rule.uses_power:
            squares = high.square().sum(-2) if self.shared else high.square()
            shares = self.power_shares.to(high.dtype)
            fluctuation = (1 - self.a_power) ** self.every * fluctuation + shares @ squares
        mean, stopped, shift = state.mean_weights, state.stopped, None
        if factor is not None:
            power = fluctuation if taken is None else fluctuation / taken
            change = rule.change(high.flatten(-3, -2) if self.shared else high, power, weights, self.every)
            grown, full = rule.bounded(torch.addcmul(weights, change, factor))
            learns = None if not torch.compiler.is_compiling() else factor.amax((-1, -2)) > 0
            if self.when_full == "stop":
                learns = ~stopped if learns is None else learns & ~stopped
                stopped = stopped if full is None else stopped | full
            weights = grown if learns is None else torch.where(learns[..., None, None], grown, weights)
            step = (weights.detach() - mean) * self.a_mean
            mean, shift = mean + step, torch.linalg.vector_norm(step, 1, (-1, -2))
        # By position: `_replace` costs as much as three operations.
        end = NetworkState(
            weights, outputs, state.input_low, low, state.recent, fluctuation, clock, stopped, mean, *state[9:]
        )
        return end, shift
