"""A number of objects lasts until evidence for another one has lasted, and its confidence says how much it has."""

from __future__ import annotations

import torch

from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.memory import AnswerMemory, count_confidence, each_confidence, no_answers, remember
from ndtorch.binding.readout.source_count import motion_residual
from ndtorch.binding.readout.sums import SumStatistics


def of(count: int) -> ObjectTable:
    """A table of so many objects."""
    owners = torch.arange(10) < count
    return ObjectTable(owners, torch.diag(owners.float()))


def after(memory: AnswerMemory, counts: list[int], changed: bool = False) -> AnswerMemory:
    """The memory after those numbers of objects."""
    one, now = torch.tensor(1.0), torch.tensor(changed)
    for count in counts:
        memory = remember(memory, of(count), 2 * one, one, memory.steps + 100, 0.9, now)
    return memory


def test_an_object_that_was_certain_is_not_two_a_second_later() -> None:
    memory = after(no_answers(torch.zeros(10, 10)), 8 * [1])
    assert after(memory, [2, 2]).table.owners.sum() == 1
    assert after(memory, 10 * [2]).table.owners.sum() == 2
    assert after(memory, 3 * [2]).table.owners.sum() == 1
    assert after(memory, 3 * [2], changed=True).table.owners.sum() == 2


def test_confidence_falls_with_answers_that_disagree() -> None:
    memory = after(no_answers(torch.zeros(10, 10)), 20 * [2])
    doubted = after(memory, [2, 3, 2, 3])
    assert 0.9 < count_confidence(memory) <= 1
    assert count_confidence(doubted) < count_confidence(memory)
    sure = each_confidence(doubted)
    assert (sure[:2] > 0.5).all()
    assert not sure[2:].any()
    assert count_confidence(no_answers(torch.zeros(10, 10))) == 0


def test_motion_tells_a_fourth_source_from_three_colors() -> None:
    """A detector gives products of each brightness with its own past; three colors know those of three alone."""
    t = torch.arange(1600) / 100
    light = 1 + 0.5 * torch.stack([(5 * t).sin(), (9 * t + 1).sin(), (3.3 * t).sin(), (7.1 * t).sin()], -1)
    sums = torch.zeros(1600, 10)
    colors = torch.tensor([[1.0, 0.3, 0.1], [0.2, 1.0, 0.2], [0.1, 0.3, 1.0], [0.6, 0.5, 0.8]])
    residual = []
    for bars in (3, 4):
        statistics = SumStatistics()
        slow, _ = statistics.delay(light[:, :bars])
        sums[:, :4] = (light[:, :bars] * slow) @ torch.eye(4)[:bars]
        sums[:, 7:] = light[:, :bars] @ colors[:bars]
        residual.append(float(motion_residual(statistics(100 * sums).products)))
    assert residual[0] < 1e-3
    assert residual[1] > 0.05
