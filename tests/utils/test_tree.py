"""The walk over nested tuples of tensors."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.utils.tensors import leaves, mapped


class Inner(NamedTuple):
    a: Tensor
    b: Tensor | None


class Outer(NamedTuple):
    first: Inner
    rest: tuple[Tensor, Inner]


TREE = Outer(Inner(torch.tensor(1.0), None), (torch.tensor(2.0), Inner(torch.tensor(3.0), torch.tensor(4.0))))


def test_leaves_have_dotted_names_in_order() -> None:
    assert {name: float(value) for name, value in leaves(TREE).items()} == {
        "first.a": 1.0,
        "rest.0": 2.0,
        "rest.1.a": 3.0,
        "rest.1.b": 4.0,
    }


def test_mapped_keeps_the_shape_of_the_tree() -> None:
    names: list[str] = []

    def double(name: str, part: Tensor) -> Tensor:
        names.append(name)
        return 2 * part

    out = mapped(TREE, double)
    assert isinstance(out, Outer)
    assert isinstance(out.rest[1], Inner)
    assert out.first.b is None
    assert [float(part) for part in leaves(out).values()] == [2.0, 4.0, 6.0, 8.0]
    assert names == list(leaves(TREE))
