"""Neurons that own objects."""

from __future__ import annotations

import torch

from ndtorch.binding.readout.owners import distinct


def test_copies_of_stronger_owners_are_left_out() -> None:
    strength = torch.tensor([1.0, 3.0, 2.0])
    alike = torch.tensor([[1, 0, 0], [0, 1, 1], [0, 1, 1]]).bool()
    assert distinct(torch.tensor([True, True, True]), strength, alike).tolist() == [True, True, False]
    assert distinct(torch.tensor([True, False, True]), strength, alike).tolist() == [True, False, True]
