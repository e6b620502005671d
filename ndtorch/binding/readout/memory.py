"""What a read-out remembers of its answers: a number of objects changes when evidence for another one has lasted."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.binding.objects import ObjectTable

MOST = 10
"""Largest number of objects of a table."""

BEFORE = 0.5
"""What is left of votes from before a change of the scene."""
CLEAR = 3.0
"""Margin beyond which more makes no difference."""
OF_COUNT = (-12.2, 11.2, 0.770, 0.817)
"""Logistic regression of "the number is right" on 1, share of the votes, their sum and margin: 2 537 answers, from 6 s
to 64 s, of 43 scenes of the split tune and of the papers' bars in step and at every 60°, 25 frames a second."""
OF_OBJECT = (-5.95, 7.85, 1.59)
"""The same of "F1 with a bar is .75 or more" on 1, likeness over time and the confidence of the number."""


class AnswerMemory(NamedTuple):
    """Answers so far, taken once a second.

    Attributes:
        votes: for every number of objects from 0 on, leaky sum of the answers, `[..., 11]`.
        owners, rows: the latest table with the number that has most votes, `[..., 10]` bool and `[..., 10, 10]`.
        seen: of each of its objects, leaky sum of its likeness to the answers since it is there, `[..., 10]`.
        margin: leaky mean of the answers' margins, `[...]`.
        steps: time steps at the latest answer, int64 scalar.
    """

    votes: Tensor
    owners: Tensor
    rows: Tensor
    seen: Tensor
    margin: Tensor
    steps: Tensor

    @property
    def table(self) -> ObjectTable:
        """The objects."""
        return ObjectTable(self.owners, self.rows)


def no_answers(like: Tensor) -> AnswerMemory:
    """The memory before the first answer, for weights like `[..., 10, 10]`."""
    batch, n = like.shape[:-2], like.shape[-1]
    return AnswerMemory(
        like.new_zeros(*batch, MOST + 1),
        torch.zeros(*batch, n, dtype=torch.bool, device=like.device),
        like.new_zeros(*batch, n, n),
        like.new_zeros(*batch, n),
        like.new_zeros(batch),
        torch.zeros((), dtype=torch.int64),
    )


def remember(
    memory: AnswerMemory,
    table: ObjectTable,
    margin: Tensor,
    weight: Tensor,
    steps: Tensor,
    keep: float,
    changed: Tensor,
) -> AnswerMemory:
    """The memory after one more answer of weight 0 to 1, when `keep` is left of those before. Where the scene has
    `changed`, votes for other numbers are `BEFORE` of what they were.
    """
    number = table.owners.sum(-1)
    vote = torch.nn.functional.one_hot(number, MOST + 1).to(memory.votes.dtype)
    before = torch.where(changed.unsqueeze(-1), BEFORE + (1 - BEFORE) * vote, 1.0) * memory.votes
    votes = keep * before + weight.unsqueeze(-1) * vote
    here = (votes.argmax(-1) == number)[..., None]
    # Cosine of what is kept and what is seen now, of owners alone.
    alike = unit(memory.rows) @ unit(table.rows).mT
    before = torch.where(here, keep * (alike.mT * memory.seen.unsqueeze(-2)).amax(-1), keep * memory.seen)
    seen = before + weight.unsqueeze(-1) * torch.where(here, 1.0, alike.amax(-1))
    owners = torch.where(here, table.owners, memory.owners)
    rows = torch.where(here.unsqueeze(-1), table.rows, memory.rows)
    first = memory.votes.sum(-1) == 0
    clear = torch.where(first, margin, keep * memory.margin + (1 - keep) * margin)
    return AnswerMemory(votes, owners, rows, torch.where(owners, seen, 0.0), clear, steps.clone())


def unit(rows: Tensor) -> Tensor:
    """Rows of length 1, zeros where there is nothing."""
    length: Tensor = torch.linalg.vector_norm(rows, dim=-1, keepdim=True)
    return rows / length.clamp_min(1e-6)


def count_evidence(memory: AnswerMemory) -> Tensor:
    """What `OF_COUNT` weighs: 1, the share of votes for the number, their sum, and the margin, `[..., 4]`."""
    votes = memory.votes.sum(-1)
    share = memory.votes.amax(-1) / votes.clamp_min(1e-6)
    return torch.stack([torch.ones_like(share), share, votes, memory.margin.to(share.dtype).clamp_max(CLEAR)], -1)


def count_confidence(memory: AnswerMemory) -> Tensor:
    """Probability that the number of objects is right, `[...]`; 0 before the first answer."""
    known = count_evidence(memory)
    sure = torch.sigmoid((known * known.new_tensor(OF_COUNT)).sum(-1))
    return torch.where(memory.votes.sum(-1) > 0, sure, 0.0)


def each_evidence(memory: AnswerMemory) -> Tensor:
    """What `OF_OBJECT` weighs: 1, how alike the object was in all answers, and the confidence of the number,
    `[..., 10, 3]`."""
    alike = (memory.seen / memory.votes.sum(-1, keepdim=True).clamp_min(1e-6)).clamp_max(1)
    return torch.stack([torch.ones_like(alike), alike, count_confidence(memory).unsqueeze(-1).expand_as(alike)], -1)


def each_confidence(memory: AnswerMemory) -> Tensor:
    """Probability that an object of these features is in view, of the object of each neuron, `[..., 10]`."""
    known = each_evidence(memory)
    sure = torch.sigmoid((known * known.new_tensor(OF_OBJECT)).sum(-1))
    return torch.where(memory.owners, sure, 0.0)
