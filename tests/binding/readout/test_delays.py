"""Telling sources apart by delays."""

from __future__ import annotations

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.binding.readout.joint_diagonalisation import diagonalise


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.integers(2, 6))
def test_common_diagonal_is_found(seed: int, size: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    basis = torch.linalg.qr(torch.randn(1, size, size, generator=generator, dtype=torch.float64)).Q
    diagonal = torch.randn(1, 4, size, generator=generator, dtype=torch.float64)
    rotation, result = diagonalise(basis.unsqueeze(1) @ torch.diag_embed(diagonal) @ basis.mT.unsqueeze(1))
    assert_allclose(rotation.mT @ rotation, torch.eye(size).expand(1, size, size), atol=1e-9)
    assert_allclose(result, torch.diag_embed(result.diagonal(dim1=-2, dim2=-1)), atol=1e-5)
