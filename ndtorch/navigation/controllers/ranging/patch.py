"""A patch of the world around the car, remembered for seconds: what is blocked, what was seen free."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.odometry import Pose


@dataclass(frozen=True)
class PatchParams:
    """A square of square cells that moves with the car.

    Args:
        cell: side of a cell, m.
        size: cells along a side, a power of two; beyond it everything is forgotten.
        lifetime: seconds in which evidence falls to 1/e.
        most, least: evidence stays between `-least` and `most`. What was seen free shall be believed blocked
            within four frames, what is blocked shall not be freed by a few cells that look like floor.
    """

    cell: float = 0.08
    size: int = 64
    lifetime: float = 10.0
    most: float = 5.0
    least: float = 2.0

    def __post_init__(self) -> None:
        check_numbers(self, endless=["lifetime"])
        if not (self.cell > 0 and self.size >= 2 and self.size & (self.size - 1) == 0):
            raise InputError(f"expected cell > 0 and size a power of two, got cell={self.cell}, size={self.size}")
        if not (self.lifetime > 0 and self.most > 0 and self.least > 0):
            raise InputError(f"expected lifetime, most and least > 0, got {self}")

    @property
    def reach(self) -> float:
        """Places nearer than this along either axis are inside, m."""
        return (self.size // 2 - 1) * self.cell


class Patch(NamedTuple):
    """Evidence about the world around the car.

    Attributes:
        evidence: `[..., size * size]`, positive where something is, negative where floor was seen. A place is
            in the cell of its world coordinates (in cells, rounded down) modulo `size`.
        tag: `[..., 2, size]`, which of the places that share a row or column it stands for.
        upright: evidence of what stands above floor that is seen, of the same places; `[..., 0]` where it is not
            remembered apart.
    """

    evidence: Tensor
    tag: Tensor
    upright: Tensor


def empty_patch(pose: Pose, params: PatchParams, upright: bool = False) -> Patch:
    """Nothing is known; what stands is remembered apart, or is not."""
    numbers = torch.arange(params.size, dtype=pose.x.dtype, device=pose.x.device)
    blank = pose.x.new_zeros(*pose.x.shape, params.size**2)
    return Patch(blank, tags(pose, numbers, params), blank if upright else blank[..., :0])


def tags(pose: Pose, numbers: Tensor, params: PatchParams) -> Tensor:
    """How often each row and column has been wrapped around where the car is, `[..., 2, size]`."""
    here = torch.stack((pose.x, pose.y), -1).div(params.cell).floor().unsqueeze(-1)
    return ((here - numbers) / params.size + 0.5).floor()


def move_patch(patch: Patch, pose: Pose, numbers: Tensor, keep: Tensor, params: PatchParams) -> Patch:
    """Forget what has left the square, and of the rest all but the share `keep` `[...]`."""
    tag = tags(pose, numbers, params)
    same = (tag == patch.tag).to(tag.dtype)
    rows, columns = same.unbind(-2)
    kept = ((rows * keep.unsqueeze(-1)).unsqueeze(-1) * columns.unsqueeze(-2)).flatten(-2)
    upright = patch.upright * kept if patch.upright.shape[-1] else patch.upright
    return Patch(patch.evidence * kept, tag, upright)


def cell_numbers(places: Tensor, pose: Pose, params: PatchParams) -> Tensor:
    """Numbers of the cells that hold places of the body frame, `[..., 2, n] -> [..., n]`."""
    cos, sin = pose.heading.cos() / params.cell, pose.heading.sin() / params.cell
    turn = torch.stack((cos, -sin, sin, cos), -1).view(*cos.shape, 2, 2)
    at = torch.stack((pose.x, pose.y), -1).div(params.cell).unsqueeze(-1)
    wrapped: Tensor = (turn @ places).add_(at).floor_().to(torch.int64).bitwise_and_(params.size - 1)
    return wrapped[..., 0, :] * params.size + wrapped[..., 1, :]


def add_evidence(patch: Patch, number: Tensor, weight: Tensor, params: PatchParams) -> Patch:
    """Add weights `[..., n]` to cells."""
    evidence = patch.evidence.scatter_add(-1, number, weight).clamp(-params.least, params.most)
    return patch._replace(evidence=evidence)
