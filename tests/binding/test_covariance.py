"""Running covariances: weighted means, of any chunks, and as a program."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from numpy.testing import assert_allclose

from ndtorch.binding.covariance import CovarianceState, RunningCovariances
from ndtorch.binding.readout.owners import signal_statistics
from ndtorch.binding.readout.sums import SumStatistics
from tests.compilers import exports
from tests.strategies import chunkings


def noise(length: int, signals: int) -> torch.Tensor:
    return torch.randn(length, signals, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


@settings(max_examples=10, deadline=None)
@given(lengths=chunkings(230))
def test_statistics_do_not_depend_on_chunks(lengths: list[int]) -> None:
    signals = noise(230, 10)
    for module in (signal_statistics(), SumStatistics().scene, SumStatistics().all):
        state: Any = None
        for chunk in torch.split(signals, lengths):
            state = module(chunk, state)
        for one, other in zip(state, module(signals), strict=True):
            assert torch.equal(one, other)


def test_they_are_the_weighted_means_in_every_memory_at_every_delay() -> None:
    # Whole tenths of a second count: the last five samples have to wait.
    signals = noise(65, 2)
    module = RunningCovariances(0.01, (0.5, 2.0), (0.0, 0.03), tau_high=math.inf, differences=True)
    state = module(signals)
    past = torch.cat([torch.zeros(3, 2, dtype=torch.float64), signals])
    for m, tau in enumerate((0.5, 2.0)):
        a = 0.01 / (tau + 0.01)
        share = [a * (1 - a) ** (59 - n) for n in range(60)]
        for k, lag in enumerate((0, 3)):
            products = [share[n] * torch.outer(signals[n], past[n + 3 - lag]) for n in range(60)]
            expected = torch.stack(products).sum(0)
            assert_allclose(state.covariances[m, k], (expected + expected.mT) / 2, atol=1e-12)
        changes = [signals[n] - past[n + 2] for n in range(60)]
        expected = torch.stack([share[n] * torch.outer(changes[n], changes[n]) for n in range(60)]).sum(0)
        assert_allclose(state.differences[m], expected, atol=1e-12)


class Exported(torch.nn.Module):
    def __init__(self, module: RunningCovariances) -> None:
        super().__init__()
        self.module = module

    def forward(self, signals: torch.Tensor, *state: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return tuple(part.clone() for part in self.module(signals, CovarianceState(*state)))


@pytest.mark.parametrize(
    "module", [signal_statistics(), RunningCovariances(0.01, (3.0, 9.0), (0.01, 0.2), pieces=2, piece=0.2)]
)
@exports
def test_a_program_goes_on_wherever_a_chunk_begins(module: Any) -> None:
    # Seven samples a chunk against blocks of ten: chunks with no, and with one whole block.
    chunks = torch.split(noise(70, 3), 7)
    state: Any = module(chunks[0])
    program = torch.export.export(Exported(module), (chunks[1], *state)).module()
    kept = tuple(state)
    for chunk in chunks[1:]:
        state, kept = module(chunk, state), program(chunk, *kept)
        for one, other in zip(kept, state, strict=True):
            assert one.shape == other.shape
            assert_allclose(one, other, atol=1e-12)


def test_pieces_are_the_means_of_each_stretch_of_time() -> None:
    # Pieces of two updates of ten samples, of which the latest two are kept; the last five samples have to wait.
    signals = noise(75, 2)
    state = RunningCovariances(0.01, (1.0,), (0.0,), tau_high=math.inf, pieces=2, piece=0.2)(signals)
    assert state.held.tolist() == [2, 1]
    for n, (start, stop) in enumerate(((40, 60), (60, 70))):
        part = signals[start:stop]
        assert_allclose(state.pieces[n, 0] / state.held[n], part.T @ part / len(part), atol=1e-12)
