"""Networks by kernels give what torch gives."""

from __future__ import annotations

import pytest
import torch

from ndtorch.binding import network_kernels
from ndtorch.binding._kernels import held_back
from ndtorch.binding.network import InhibitoryNetwork
from ndtorch.binding.network_kernels import delayed_fits
from ndtorch.binding.rules import LearningRule, ScaleFreeRule, learning_rule
from ndtorch.binding.spectrum import limit_spectral_radius

RULES = {
    "published": learning_rule("competitive"),
    "fast": learning_rule("competitive", gamma=40.0, tau_onset=0.0),
    "held back": learning_rule("competitive", gamma=40.0, radius_limit=0.05),
    "not held back": learning_rule("cooperative", g="tanh-10", radius_limit=float("inf")),
    "Hebb": learning_rule("hebbian", gamma=5.0),
    "fixed": None,
}


def signals(kind: torch.dtype) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    inputs = torch.rand(90, 6, generator=generator, dtype=kind)
    inputs[:, 3] = 0.8 * inputs[:, 1] + 0.1 * inputs[:, 3]
    inputs[:, 5] = 0  # silent
    return inputs


@pytest.mark.parametrize(("kind", "close"), [(torch.float32, 2e-5), (torch.float64, 1e-9)])
@pytest.mark.parametrize("name", RULES)
@pytest.mark.parametrize("tau_in", [1.0, float("inf")])
def test_delayed_feedback(
    name: str, tau_in: float, kind: torch.dtype, close: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rule, inputs = RULES[name], signals(kind)
    start = torch.full((6, 6), 0.05).fill_diagonal_(0) if rule is None else None
    network = InhibitoryNetwork(6, rule=rule, settle=0.2, tau_in=tau_in, window=0.3, initial=start)
    network.backend = "torch"
    plain, end = network(inputs)
    network.backend = "numba"
    monkeypatch.setattr(network, "_drive", None)  # which the reference needs
    state, parts = None, []
    with torch.inference_mode():
        for chunk in inputs.split(8):
            out, state = network(chunk, state)
            parts.append(out)
    assert state is not None
    assert torch.allclose(torch.cat(parts), plain, rtol=0, atol=close)
    for field, one, other in zip(end._fields, end, state, strict=True):
        assert (one.shape, one.dtype) == (other.shape, other.dtype), field
        assert torch.allclose(one.double(), other.double(), rtol=0, atol=close), field
    assert float(end.weights.max()) > 0.001
    if name == "held back":
        free, _ = InhibitoryNetwork(6, rule=RULES["fast"], settle=0.2, tau_in=tau_in)(inputs)
        assert float((free - plain).abs().max()) > 0.01


def test_weights_are_held_back_as_by_the_reference() -> None:
    """Random weights, triangular ones, and loops that a power never settles on, beyond and below a limit."""
    generator, certain = torch.Generator().manual_seed(1), 0
    for k in range(90):
        size = (2, 6, 10)[k // 30]
        weights = torch.rand(size, size, generator=generator, dtype=torch.float64).fill_diagonal_(0)
        weights = weights.triu() if k % 3 == 1 else weights * (weights > 0.6) if k % 3 == 2 else weights
        found = held_back(weights.numpy(), 0.3)
        if found == found:
            certain += 1
            assert torch.allclose(weights * found, limit_spectral_radius(weights, 0.3), rtol=1e-8, atol=0)
    assert certain > 45


def test_what_is_not_certain_is_left_to_the_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole stretches are made again, from where they began."""
    network, inputs = InhibitoryNetwork(6, rule=RULES["held back"], settle=0.2), signals(torch.float32)
    network.backend = "torch"
    plain, end = network(inputs)
    network.backend = "auto"
    made = network_kernels.delayed_network

    monkeypatch.setattr(network_kernels, "delayed_network", lambda *given: int(made(*given)) - 1)
    with torch.inference_mode():
        out, state = network(inputs)
    assert torch.equal(out, plain)
    assert torch.equal(state.weights, end.weights)


def test_what_does_not_fit() -> None:
    inputs = signals(torch.float32)
    with torch.inference_mode():
        for network, given in (
            (InhibitoryNetwork(6), inputs.expand(2, -1, -1)),
            (InhibitoryNetwork(6, rule=LearningRule(torch.sign, torch.sign)), inputs),
            (InhibitoryNetwork(6, when_full="stop"), inputs),
            (InhibitoryNetwork.scale_free(6), inputs),
        ):
            assert not delayed_fits(given, network.start(given[..., 0, :]), network.constants, "auto")


@pytest.mark.parametrize(("kind", "close"), [(torch.float32, 1e-5), (torch.float64, 1e-12)])
@pytest.mark.parametrize("limit", [0.95, 0.2])
def test_a_network_that_fields_share(
    kind: torch.dtype, close: float, limit: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    generator = torch.Generator().manual_seed(1)
    inputs = torch.rand(60, 6, 5, generator=generator, dtype=kind) * torch.rand(6, 5, generator=generator, dtype=kind)
    inputs[:, :, 3] = 0.8 * inputs[:, :, 1] + 0.1 * inputs[:, :, 3]
    # Nothing happens for a while.
    inputs[20:35] = inputs[20]
    rule, taus = ScaleFreeRule(radius_limit=limit), {"tau_in": torch.inf, "tau_out": 0.2}
    network = InhibitoryNetwork(5, 0.04, rule, "settled", shared=True, settle=0.0, faint=0.05, **taus)
    network.backend = "torch"
    plain, end = network(inputs)
    network.backend = "numba"
    careful, step = 0, network_kernels.network_step

    def counted(*given: object) -> object:
        nonlocal careful
        careful += 1
        return step(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(network_kernels, "network_step", counted)
    state, parts = None, []
    with torch.inference_mode():
        for chunk in inputs.split(7):
            out, state = network(chunk, state)
            parts.append(out)
    assert state is not None
    assert torch.allclose(torch.cat(parts), plain, rtol=0, atol=close)
    for name, one, other in zip(end._fields, end, state, strict=True):
        assert one.shape == other.shape, name
        assert one.dtype == other.dtype, name
        assert torch.allclose(one.double(), other.double(), rtol=0, atol=10 * close), name
    assert float(end.weights.abs().max()) > 0.05
    assert float(end.clock) < 60
    # Weights near their limit are left to the reference.
    assert (careful > 0) == (limit < 0.5)
