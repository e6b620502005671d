"""The scale-free competitive rule and the network that applies it with its feedback settled.

**The network.** `o = (I + T)^-1 y`, what `o(t + dt) = y - T o(t)` comes to rest at [B eq. 22]. It exists at any time
step: the Perron root of |T| is at most .95, so -1 is no eigenvalue of T, and `(I + T)^-1` is bounded.

**The rule.** `dT[n, k]/dt = gamma (c <o'_n o'_k> / s_k^2 - leak (1 - c) T[n, k])` with the gate `c = s_k^p / (s_k^p +
s_n^p)`; s is the deviation of an output. Both terms keep their value when all signals are multiplied by a constant,
hence the name: weak signals learn as fast as strong ones. T is dimensionless in the same way, a ratio of two signals'
shares of a source.

**Fixed points.** With `r = <o'_n o'_k> / s_k^2`, the regression of output n on output k, the rule is at rest where
`T[n, k] = c r / (leak (1 - c))`. Where k is much stronger than n the gate is 1 and only r = 0 will do: the weaker
output is free of the stronger one. Where k is much weaker the gate is 0 and only T = 0 will do: nobody takes a weak
output out of a strong one. So at a fixed point with outputs of clearly different strength T is triangular in the
order of their strength and all outputs are uncorrelated: with sources that do not go together, owner 1 keeps what it
receives, owner 2 keeps its input less what goes along with owner 1, and so on (a Cholesky factor of the covariance,
taken in the order of what is left: the greedy selection of owners). Outputs that receive no further source become
silent. Owners whose own input holds one source only, plus stronger owners' sources, are exact copies of their source,
and their columns of T are its mixing coefficients relative to the owner; an owner that receives two sources first is
not purified, for weaker neurons may not act on it. That is what the read-out by delays repairs.

**Stability.** Let the gate stand still and all weights but T[n, k] be at rest. From `(I + T) o = y`, `d o_n / dT[n,
k] = -o_k / (1 - T[n, k] T[k, n])` for two neurons, so at r = 0 the bracket of the rule falls with T[n, k] at the rate
`c / (1 - T[n, k] T[k, n]) + leak (1 - c)`: positive as long as the loop stays below 1, which the limit on the Perron
root ensures. Perturbations die out with a time constant of about `1 / gamma`, 5 s in the long run, whatever the
strengths; steps do not overshoot, for `gamma dt` is .16 at first with changes every 50 ms, and .01 later. Two outputs
of equal strength have c = 1/2, and share: `T = r / leak` both ways, uncorrelated only if their inputs are. In phase,
sources are one source, and one owner is all there can be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.binding.spectrum import limit_spectral_radius
from ndtorch.errors import InputError
from ndtorch.vision.blocks import BlockLowPass, aligned
from ndtorch.vision.temporal import smoothing_factor, time_dim


@dataclass(frozen=True)
class ScaleFreeRule:
    """`dT[n, k]/dt = gamma(t) mu(t) (c o'_n o'_k / s_k^2 - leak (1 - c) T[n, k])`, gate `c = s_k^p / (s_k^p + s_n^p)`.

    Attributes:
        gamma: learning rate in the long run, 1/s.
        boost: how many times faster learning is at first, less one.
        tau_boost: time constant with which that subsides, seconds.
        tau_onset: soft start, seconds.
        exponent: p of the gate.
        leak: how fast weights from the weaker to the stronger are forgotten, against `gamma`.
        floor: smallest s, as a share of the largest.
        lowest, highest: bounds of the weights.
        radius_limit: of the Perron root of the weights' magnitudes.
    """

    gamma: float = 0.2
    boost: float = 15.0
    tau_boost: float = 4.0
    tau_onset: float = 0.2
    exponent: float = 4.0
    leak: float = 2.0
    floor: float = 0.02
    lowest: float = -0.4
    highest: float = 1.2
    radius_limit: float = 0.95

    def rate(self, seconds: float) -> float:
        """`gamma(t) mu(t)`, 1/s, at `seconds` since learning began."""
        if seconds <= 0:
            return 0.0
        mu = 1.0 if self.tau_onset == 0 else -math.expm1(-seconds / self.tau_onset)
        return self.gamma * (1 + self.boost * math.exp(-seconds / self.tau_boost)) * mu

    def change(self, products: Tensor, power: Tensor, weights: Tensor) -> Tensor:
        """The bracket of the rule, `[..., N, N]`.

        Args:
            products: mean of `o'_n o'_k`, `[..., N, N]`.
            power: running mean of `o'^2`, `[..., N]`.
            weights: T, `[..., N, N]`.
        """
        largest = power.amax(-1, keepdim=True).clamp_min(torch.finfo(power.dtype).tiny)
        relative = (power / largest).clamp_min(self.floor**2)
        high = relative ** (self.exponent / 2)
        sender, receiver = high.unsqueeze(-2), high.unsqueeze(-1)
        gate = sender / (sender + receiver)
        correlation = products / (relative * largest).unsqueeze(-2)
        return gate * correlation - self.leak * (1 - gate) * weights

    def bounded(self, weights: Tensor) -> Tensor:
        """Weights within their bounds, the diagonal zero, the Perron root of their magnitudes within its limit."""
        clipped = weights.clamp(self.lowest, self.highest)
        clipped.diagonal(dim1=-2, dim2=-1).zero_()
        size = clipped.abs()
        limited = limit_spectral_radius(size, self.radius_limit)
        return clipped if limited is size else torch.copysign(limited, clipped)


class ScaleFreeState(NamedTuple):
    """Everything of the network that changes.

    Attributes:
        weights: `[..., N, N]`.
        output_low: what the high-pass of the outputs has taken for the mean, `[..., N]`.
        power: running mean of o'^2, `[..., N]`.
        recent: the latest inputs, as many as lie between changes of the weights, `[..., E, N]`, oldest first.
        mean_weights: running temporal mean of the weights, `[..., N, N]`.
        changes: summed magnitude of the changes of that mean at each recent change, `[..., S]`, oldest first.
        steps: time steps taken since the start, int64 scalar.
    """

    weights: Tensor
    output_low: Tensor
    power: Tensor
    recent: Tensor
    mean_weights: Tensor
    changes: Tensor
    steps: Tensor


def settled(weights: Tensor) -> Tensor:
    """`(I + T)^-1`: what the network makes of a steady input, `[..., N, N]`."""
    eye = torch.eye(weights.shape[-1], dtype=weights.dtype, device=weights.device)
    inverse: Tensor = torch.linalg.inv_ex(eye + weights)[0]
    return inverse


class ScaleFreeNetwork(nn.Module):
    """`o = (I + T)^-1 y`, T learned by the scale-free rule.

    Args:
        neurons: N.
        dt: time step in seconds.
        rule: the learning rule.
        tau_out: high-pass of the outputs in the rule, seconds.
        tau_power: memory of their power, seconds.
        settle: seconds before learning starts.
        every: seconds between changes of the weights; the rule takes the mean of the products in between.
        window, tau_mean: of `weight_change`, as in `InhibitoryNetwork`, seconds.

    Shapes:
        inputs `[..., T, N]` -> outputs `[..., T, N]`; state `ScaleFreeState`, `None` starts at rest.
    """

    def __init__(
        self,
        neurons: int = 10,
        dt: float = 0.01,
        rule: ScaleFreeRule | None = None,
        tau_out: float = 2.0,
        tau_power: float = 3.0,
        settle: float = 0.5,
        every: float = 0.05,
        window: float = 1.0,
        tau_mean: float = 2.0,
    ) -> None:
        super().__init__()
        if neurons < 2:
            raise InputError(f"a network needs at least 2 neurons, got {neurons}")
        self.neurons, self.dt, self.settle = neurons, dt, settle
        self.rule = rule or ScaleFreeRule()
        self.every = max(1, round(every / dt))
        self.low_pass = BlockLowPass(smoothing_factor(tau_out, dt), self.every)
        self.mean = BlockLowPass(smoothing_factor(tau_power, dt), self.every)
        self.a_mean = smoothing_factor(tau_mean, dt * self.every)
        self.window_changes = max(1, round(window / (dt * self.every)))

    def start(self, first: Tensor) -> ScaleFreeState:
        """State at rest for inputs like `first` `[..., N]`."""
        zeros = torch.zeros_like(first)
        weights = first.new_zeros(*first.shape, self.neurons)
        changes = first.new_zeros(*first.shape[:-1], self.window_changes)
        recent = first.new_zeros(*first.shape[:-1], self.every, self.neurons)
        return ScaleFreeState(weights, zeros, zeros, recent, weights, changes, torch.zeros((), dtype=torch.int64))

    def forward(self, inputs: Tensor, state: ScaleFreeState | None = None) -> tuple[Tensor, ScaleFreeState]:
        time_dim(inputs, 1)
        if inputs.shape[-1] != self.neurons:
            raise InputError(f"inputs must be [..., T, {self.neurons}], got {tuple(inputs.shape)}")
        state = self.start(inputs[..., 0, :]) if state is None else state
        weights, low, power, mean_weights = state.weights, state.output_low, state.power, state.mean_weights
        first, length = int(state.steps), inputs.shape[-2]
        samples = torch.cat([state.recent, inputs], -2)
        passage = settled(weights).mT
        outs, changes, done = [], [], 0
        for number, block in enumerate(aligned(samples, length, first, self.every)):
            out = block @ passage
            upto = self.every - first % self.every + number * self.every
            outs.append(out[..., self.every - (upto - done) :, :])
            done = upto
            lows = self.low_pass(out, low)
            low = lows[..., -1, :]
            high = out - lows
            kept, taken = self.mean.weights(high)
            power = kept * power + taken @ high.square()
            weights, changed = self._learn(weights, power, high.mT @ high, first + done)
            if changed:
                passage = settled(weights).mT
                shift = (weights - mean_weights) * self.a_mean
                mean_weights = mean_weights + shift
                changes.append(shift.abs().sum((-1, -2)))
        if done < length:
            outs.append(inputs[..., done:, :] @ passage)
        recent_changes = torch.cat([state.changes, torch.stack(changes, -1)], -1) if changes else state.changes
        end = ScaleFreeState(
            weights=weights,
            output_low=low,
            power=power,
            recent=samples[..., length:, :],
            mean_weights=mean_weights,
            changes=recent_changes[..., -self.window_changes :],
            steps=torch.tensor(first + length, dtype=torch.int64),
        )
        return torch.cat(outs, -2), end

    def _learn(self, weights: Tensor, power: Tensor, products: Tensor, step: int) -> tuple[Tensor, bool]:
        rate = self.rule.rate(step * self.dt - self.settle)
        if rate == 0:
            return weights, False
        # The running mean starts at zero: early on it has not seen its share yet.
        seen = -math.expm1(step * math.log1p(-self.mean.a)) if self.mean.a < 1 else 1.0
        change = self.rule.change(products / self.every, power / seen, weights)
        return self.rule.bounded(weights + (rate * self.dt * self.every) * change), True
