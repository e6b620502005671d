"""Sources by joint diagonalisation: the rotation, number and mixing, and light that changes everywhere."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from torch import Tensor

from ndtorch.binding.readout.joint_diagonalisation import diagonalise, sources_of
from ndtorch.binding.readout.owners import SourceCriteria, SumCriteria
from ndtorch.binding.readout.source_count import undisturbed
from ndtorch.binding.readout.sums import SumStatistics
from tests.binding.readout.three_lights import MIXING, count, lights


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.integers(2, 6))
def test_common_diagonal_is_found(seed: int, size: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    basis = torch.linalg.qr(torch.randn(1, size, size, generator=generator, dtype=torch.float64)).Q
    diagonal = torch.randn(1, 4, size, generator=generator, dtype=torch.float64)
    rotation, result = diagonalise(basis.unsqueeze(1) @ torch.diag_embed(diagonal) @ basis.mT.unsqueeze(1))
    assert_allclose(rotation.mT @ rotation, torch.eye(size).expand(1, size, size), atol=1e-9)
    assert_allclose(result, torch.diag_embed(result.diagonal(dim1=-2, dim2=-1)), atol=1e-5)


def separated(sums: Tensor) -> tuple[int, Tensor, float]:
    """Number, mixing and gap of the sources in the long memory."""
    kept = undisturbed(SumStatistics()(sums).all, 12.0, 1.0, SumCriteria())
    found = sources_of((kept / kept[0].diagonal().amax()).double(), SourceCriteria(), SumCriteria())
    return int(found.number), found.mixing, float(found.gap)


def test_the_mixing_of_known_sources_is_found() -> None:
    number, mixing, _ = separated(lights(40) @ MIXING)
    assert number == 3
    unit = torch.nn.functional.normalize
    likeness = unit(mixing[:3].float(), dim=-1) @ unit(MIXING, dim=-1).T
    assert likeness.amax(-1).min() > 0.99
    assert sorted(likeness.argmax(-1).tolist()) == [0, 1, 2]


def test_equal_rates_are_said_to_be_indistinct() -> None:
    t = torch.arange(3000) / 100
    equal = torch.stack([torch.sin(5 * t), torch.sin(5 * t + 1.5)], -1)
    other = torch.stack([torch.sin(5.5 * t), torch.sin(8.2 * t + 1.5)], -1)
    assert separated(equal @ MIXING[:2])[2] < 0.02 < separated(other @ MIXING[:2])[2]


@pytest.mark.parametrize("bars", [0, 1, 2, 3])
def test_a_lamp_on_everything_is_no_object(bars: int) -> None:
    t = torch.arange(1500) / 100
    lamp = torch.zeros(10)
    lamp[4:] = 0.4
    sums = lights(15)[:, :bars] @ MIXING[:bars] + (2 + torch.sin(7 * t + torch.sin(t)))[:, None] * lamp
    assert count(SumStatistics()(100 * sums)) == bars


def covariances(*sources: tuple[float, list[float]]) -> torch.Tensor:
    """Of sources that do not know of each other, by their variance and their share of each signal, `[1, 10, 10]`."""
    total = torch.zeros(10, 10, dtype=torch.float64)
    for variance, share in sources:
        total += variance * torch.outer(*[torch.tensor(share, dtype=torch.float64)] * 2)
    return total[None]


STANDS = [0, 0, 0, 0, 0.2, 0.2, 0.2, 1, 1, 1]
MOVES = [0, 0.5, 0, 0, 0.2, 0.2, 0.2, 1, 1, 1]
BAR = [0, 1.0, 0, 0, 1, 0.3, 0, 1, 0, 0]
