"""The network of the papers as a plain loop over time, in NumPy."""

from __future__ import annotations

import math

import numpy as np
import torch

from ndtorch.binding import InhibitoryNetwork, learning_rule


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    """Uniform in -1..1."""
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64) * 2 - 1


def reference(
    inputs: np.ndarray,
    rule: str,
    dt: float = 0.01,
    gamma: float = 5.0,
    tau_in: float = 0.7,
    tau_out: float = 0.3,
    settle: float = 0.1,
    tau_onset: float = 0.2,
    limit: float = math.inf,
    when_full: str = "rescale",
    initial: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """[B eq. 22-24] entry by entry: outputs `[T, N]`, weights after each step `[T, N, N]`, mean weights."""
    steps, count = inputs.shape
    weights = np.zeros((count, count)) if initial is None else initial.copy()
    outputs, out_low, in_low = np.zeros(count), np.zeros(count), inputs[0].copy()
    mean, stopped = weights.copy(), False
    trace, history = [], []
    for t in range(steps):
        in_low = in_low + dt / (tau_in + dt) * (inputs[t] - in_low)
        outputs = (inputs[t] - in_low) - weights @ outputs
        out_low = out_low + dt / (tau_out + dt) * (outputs - out_low)
        since = t * dt - settle
        if since > 0 and not stopped:
            mu = 1 - math.exp(-since / tau_onset)
            high = outputs - out_low
            new = weights.copy()
            for n in range(count):
                for k in range(count):
                    if n == k:
                        continue
                    g_n, g_k = math.tanh(math.pi * high[n]), math.tanh(math.pi * high[k])
                    product = g_n * high[k] ** 3 if rule == "competitive" else high[n] ** 3 * g_k
                    if rule == "hebbian":
                        product = high[n] * high[k]
                    new[n, k] = max(0.0, weights[n, k] + dt * gamma * mu * product)
            rho = max(abs(np.linalg.eigvals(new)))
            if rho > limit:
                new, stopped = new * limit / rho, when_full == "stop"
            weights = new
        if since > 0:
            mean = mean + dt / (2.0 + dt) * (weights - mean)
        trace.append(outputs)
        history.append(weights)
    return np.array(trace), np.array(history), mean


def small(rule: str = "competitive", gamma=5.0, tau_onset=0.2, radius_limit=math.inf, **options) -> InhibitoryNetwork:
    values = {"tau_in": 0.7, "tau_out": 0.3, "settle": 0.1, **options}
    chosen = learning_rule(rule, gamma=gamma, tau_onset=tau_onset, radius_limit=radius_limit)
    return InhibitoryNetwork(3, 0.01, chosen, **values)
