"""Telling sources apart by delays."""

from __future__ import annotations

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.binding.readout.joint_diagonalisation import diagonalise, lighting
from ndtorch.binding.readout.owners import SourceCriteria


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.integers(2, 6))
def test_common_diagonal_is_found(seed: int, size: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    basis = torch.linalg.qr(torch.randn(1, size, size, generator=generator, dtype=torch.float64)).Q
    diagonal = torch.randn(1, 4, size, generator=generator, dtype=torch.float64)
    rotation, result = diagonalise(basis.unsqueeze(1) @ torch.diag_embed(diagonal) @ basis.mT.unsqueeze(1))
    assert_allclose(rotation.mT @ rotation, torch.eye(size).expand(1, size, size), atol=1e-9)
    assert_allclose(result, torch.diag_embed(result.diagonal(dim1=-2, dim2=-1)), atol=1e-5)


def test_light_moves_every_way_alike_or_hardly() -> None:
    """On the limits, which are shares that a number holds to the last bit, and beyond them."""
    criteria = SourceCriteria(even=0.5, absent=0.125, moving=0.25)
    rows = torch.ones(6, 10, dtype=torch.float64)
    rows[0, :4] = torch.tensor([1.0, 0.5, 0.5, 0.5])  # as even as must be
    rows[1, :4] = torch.tensor([1.0, 0.5, 0.5, 0.49])  # not
    rows[2, :4] = torch.tensor([0.24, 0.0, 0.0, 0.0])  # hardly, beside the others
    rows[3, :4] = torch.tensor([0.25, 0.0, 0.0, 0.0])  # a quarter
    rows[4, 7:] = torch.tensor([1.0, 1.0, 0.49])  # a color
    rows[5, 4:7] = torch.tensor([1.0, 0.5, 0.5])
    none = torch.zeros(10, 10, dtype=torch.float64)
    there = torch.ones(6, dtype=torch.bool)
    assert lighting(rows, there, none, criteria).tolist() == [True, False, True, False, False, True]
    assert not lighting(rows, ~there, none, criteria).any()
