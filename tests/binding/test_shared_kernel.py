"""A network that fields share: the kernel does what its reference does."""

from __future__ import annotations

import pytest
import torch

from ndtorch.binding import shared_kernel
from ndtorch.binding.network import InhibitoryNetwork
from ndtorch.binding.rules import ScaleFreeRule


@pytest.mark.parametrize(("kind", "close"), [(torch.float32, 1e-5), (torch.float64, 1e-12)])
@pytest.mark.parametrize("limit", [0.95, 0.2])
def test_the_kernel_is_its_reference(
    kind: torch.dtype, close: float, limit: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("numba")
    generator = torch.Generator().manual_seed(1)
    inputs = torch.rand(60, 6, 5, generator=generator, dtype=kind) * torch.rand(6, 5, generator=generator, dtype=kind)
    inputs[:, :, 3] = 0.8 * inputs[:, :, 1] + 0.1 * inputs[:, :, 3]
    # Nothing happens for a while.
    inputs[20:35] = inputs[20]
    network = InhibitoryNetwork.of_fields(5, 0.04, ScaleFreeRule(radius_limit=limit), tau_out=0.2)
    plain, end = network(inputs)
    careful, step = 0, shared_kernel.network_step

    def counted(*given: object) -> object:
        nonlocal careful
        careful += 1
        return step(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(shared_kernel, "network_step", counted)
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
