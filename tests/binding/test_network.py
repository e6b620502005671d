"""The inhibitory network beside a plain one."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.binding import InhibitoryNetwork, alternation, learning_rule, weight_change
from ndtorch.binding.network import WhenFull
from ndtorch.binding.rules import ScaleFreeRule


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


def radius(weights: torch.Tensor) -> np.ndarray:
    return abs(np.linalg.eigvals(weights.double().numpy())).max(-1)


@pytest.mark.parametrize("rule", ["competitive", "cooperative", "hebbian"])
def test_network_learns_as_a_plain_loop_does(rule: str) -> None:
    inputs = 0.8 * noise(50, 3)
    out, state = small(rule)(inputs)
    outputs, weights, mean = reference(inputs.numpy(), rule)
    assert weights[-1].max() > 0.01
    assert_allclose(out, outputs, atol=1e-12)
    assert_allclose(state.weights, weights[-1], atol=1e-12)
    assert_allclose(state.mean_weights, mean, atol=1e-12)
    assert_allclose(state.outputs, outputs[-1], atol=1e-12)
    assert int(state.steps) == 50


def test_inhibition_has_a_delay_of_its_own() -> None:
    """`o(t) = i'(t) - W o(t - tau_i)` [B eq. 18], in chunks too."""
    inputs, initial = noise(20, 3), torch.tensor([[0.0, 0.3, 0.1], [0.5, 0.0, 0.0], [0.2, 0.1, 0.0]]).double()
    network = InhibitoryNetwork(3, 0.01, None, delay=0.04, tau_in=math.inf, initial=initial)
    expected: list[torch.Tensor] = []
    for t, sample in enumerate(inputs):
        expected.append(sample - initial @ expected[t - 4] if t >= 4 else sample)
    out, _ = network(inputs)
    assert_allclose(out, torch.stack(expected), atol=1e-12)
    first, state = network(inputs[:3])
    assert torch.equal(torch.cat([first, network(inputs[3:], state)[0]]), out)
    learning, quick = (small(delay=delay)(inputs)[1].weights for delay in (0.01, 0.0))
    assert torch.equal(learning, quick)


@pytest.mark.parametrize("when_full", ["rescale", "stop"])
def test_network_is_limited_as_a_plain_loop_is(when_full: WhenFull) -> None:
    inputs = noise(50, 3) + noise(50, 1, seed=1)
    options = {"gamma": 20.0, "when_full": when_full}
    out, state = small(radius_limit=0.4, **options)(inputs)
    outputs, weights, _ = reference(inputs.numpy(), "competitive", limit=0.4, **options)
    assert_allclose(out, outputs, atol=1e-4)
    assert_allclose(state.weights, weights[-1], atol=1e-4)
    assert abs(np.linalg.eigvals(weights)).max() > 0.399
    assert bool(state.stopped) == (when_full == "stop")


def test_the_fixed_point_is_the_instantaneous_network() -> None:
    """[C eq. 2]: constant inputs settle at (I + W)^-1 i."""
    weights = torch.tensor([[0.0, 0.3], [0.5, 0.0]], dtype=torch.float64)
    network = InhibitoryNetwork(2, rule=None, tau_in=math.inf, initial=weights)
    inputs = torch.tensor([[0.0, 0.0]] + 60 * [[1.0, 2.0]], dtype=torch.float64)
    out, _ = network(inputs)
    assert_allclose(out[-1], np.linalg.solve(np.eye(2) + weights.numpy(), [1, 2]), atol=1e-10)


def test_the_power_is_a_mean_from_the_first_step_on() -> None:
    """The rule is told the mean square of what was seen so far, not one that still rises from zero."""
    told: list[tuple[torch.Tensor, torch.Tensor]] = []

    class Listening(ScaleFreeRule):
        def change(
            self, high: torch.Tensor, power: torch.Tensor, weights: torch.Tensor, steps: int = 1
        ) -> torch.Tensor:
            told.append((high, power))
            return super().change(high, power, weights, steps)

    dt, tau = 0.01, 0.5
    InhibitoryNetwork.scale_free(3, dt, Listening(), settle=0.0, every=0.05, tau_power=tau)(noise(40, 3))
    assert len(told) == 8
    squares = torch.cat([high for high, _ in told]).square()
    for n, (_, power) in enumerate(told, 1):
        age = torch.arange(5 * n - 1, -1, -1, dtype=torch.float64).unsqueeze(-1)
        share = (tau / (tau + dt)) ** age
        torch.testing.assert_close(power, (share * squares[: 5 * n]).sum(0) / share.sum(0))


@pytest.mark.parametrize("when_full", ["rescale", "stop"])
def test_a_batch_is_that_many_single_runs(when_full: WhenFull) -> None:
    count = 3
    t = torch.arange(300, dtype=torch.float64) * 0.01
    waves = torch.sin(torch.linspace(8, 30, 2 * count)[:, None] * t).reshape(count, 2, 300)
    inputs = waves.mT @ (0.2 + 0.8 * noise(count, 2, 3).abs())
    gamma = torch.linspace(0, 20, count, dtype=torch.float64)
    options = {"radius_limit": 0.5, "when_full": when_full}
    out, state = small(gamma=gamma, **options)(inputs)
    for i in range(count):
        alone, end = small(gamma=float(gamma[i]), **options)(inputs[i])
        assert_allclose(out[i], alone, atol=1e-9)
        assert_allclose(state.weights[i], end.weights, atol=1e-9)
        assert state.stopped[i] == end.stopped


@pytest.mark.parametrize("batch", [(), (2,)])
def test_gradients_of_the_outputs(batch: tuple[int, ...]) -> None:
    initial = torch.tensor([[0.0, 0.4, 0.1], [0.2, 0, 0.3], [0, 0.5, 0]], dtype=torch.float64)
    module = small(gamma=0.0, initial=initial)
    assert torch.autograd.gradcheck(lambda x: module(x)[0], (noise(*batch, 6, 3).requires_grad_(),))


def test_gradients_flow_through_learning() -> None:
    module, inputs = small(settle=0.0, tau_onset=0.0), noise(6, 3).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: module(x)[1].weights, (inputs,))


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    count=st.sampled_from([0, 1, 12]),
    when_full=st.sampled_from(["rescale", "stop"]),
    limit=st.sampled_from([0.3, 0.9, 0.95]),
    shared=st.floats(0, 1),
    dtype=st.sampled_from([torch.float32, torch.float64]),
)
def test_weights_keep_their_bounds_whatever_comes_in(
    seed: int, count: int, when_full: WhenFull, limit: float, shared: float, dtype: torch.dtype
) -> None:
    """Radius under its limit, weights never negative, diagonal zero; rates up to 50, inputs up to 1."""
    # White noise at high rates grows beyond single precision, though not beyond its limit.
    fastest = 50 if dtype == torch.float64 else 5
    rng = np.random.default_rng(seed)
    batch = (count,) if count else ()
    common = rng.uniform(-1, 1, (*batch, 40, 1)) * rng.random((*batch, 1, 4))
    inputs = torch.from_numpy(shared * common + (1 - shared) * rng.uniform(-1, 1, (*batch, 40, 4))).to(dtype)
    network = InhibitoryNetwork(
        4,
        0.01,
        learning_rule(
            "competitive", gamma=torch.as_tensor(fastest * rng.random(batch)), tau_onset=0.0, radius_limit=limit
        ),
        settle=0.0,
        when_full=when_full,
    )
    state = None
    for chunk in inputs.split(4, -2):
        _, state = network(chunk, state)
        assert (radius(state.weights) <= limit * (1 + 1e-6)).all()
        assert (state.weights >= 0).all()
        assert not state.weights.diagonal(dim1=-2, dim2=-1).any()


def test_weight_change_sums_the_recent_changes_of_the_weights() -> None:
    inputs = noise(60, 3)
    _, state = small(tau_mean=0.0, window=0.2)(inputs)
    _, weights, _ = reference(inputs.numpy(), "competitive")
    assert float(weight_change(state)) == pytest.approx(abs(np.diff(weights, axis=0))[-20:].sum())


def test_alternation_of_signals_that_flip_and_of_slow_ones() -> None:
    signs = torch.tensor([1.0, -1.0]).repeat(200)[:, None].expand(400, 2).clone()
    signs[0] = 0
    slow = torch.sin(torch.arange(400) * 0.02)[:, None].expand(400, 2)
    silent = InhibitoryNetwork(2, rule=None, tau_in=math.inf)
    assert alternation(silent(signs)[1]) == pytest.approx(1, abs=1e-3)
    assert alternation(silent(slow)[1]) < 1e-3
    white = torch.cat([torch.zeros(1, 2, dtype=torch.float64), noise(4000, 2)])
    assert alternation(silent(white)[1]) == pytest.approx(0.5, abs=0.1)
