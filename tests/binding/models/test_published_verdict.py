"""When the published model calls its weights stable, learning or alternating."""

from __future__ import annotations

import torch

from ndtorch.binding import PublishedModel
from ndtorch.binding.models.whole_field import BindingState
from tests.binding.models.small_published import model, two_things


def judged(weights: torch.Tensor | None = None, **parts: torch.Tensor) -> tuple[PublishedModel, BindingState]:
    """A model and a state of a fluctuating scene whose second network is as given."""
    module = model()
    _, state = module.from_sums(two_things(1))
    second = state.second._replace(changes=torch.zeros_like(state.second.changes), **parts)
    if weights is not None:
        second = second._replace(weights=weights)
    return module, state._replace(second=second)


def learned() -> torch.Tensor:
    weights = torch.zeros(10, 10)
    weights[1, 7], weights[0, 8] = 0.8, 0.7
    return weights


def test_settled_weights_are_stable() -> None:
    module, state = judged(learned())
    assert module.verdict(state) == "stable"
    assert [thing.neuron for thing in module.objects(state)] == ["red", "green"]


def test_weights_that_change_are_learning() -> None:
    module, state = judged(learned())
    changing = state._replace(second=state.second._replace(changes=torch.full((20,), 0.03)))
    assert module.verdict(changing) == "learning"
    assert len(module.objects(changing)) == 2


def test_small_weights_are_learning_and_no_object() -> None:
    module, state = judged(0.5 * learned())
    assert module.verdict(state) == "learning"
    assert module.objects(state) == []


def test_outputs_that_flip_are_alternating_and_no_object() -> None:
    module, state = judged(learned(), power=torch.ones(10), roughness=3.9 * torch.ones(10))
    assert module.verdict(state) == "alternating"
    assert module.objects(state) == []


def test_a_batch_has_a_verdict_and_objects_a_trial() -> None:
    module = model(gamma=2.0, settle=1.0, tau_onset=2.0, window=2.0, stable_window=1.0)
    sums = torch.stack([two_things(20), torch.full((2000, 10), 3.0), two_things(20).roll(40, 0)])
    _, state = module.from_sums(sums)
    alone = [module.from_sums(trial)[1] for trial in sums]
    assert module.verdict(state) == [module.verdict(one) for one in alone]
    assert module.verdict(state)[1] == "static"
    names = [[thing.neuron for thing in trial] for trial in module.objects_batch(state)]
    assert names == [[thing.neuron for thing in module.objects(one)] for one in alone]
    assert names[0] != names[1] == []
    _, nested = module.from_sums(sums.unsqueeze(1).expand(-1, 2, -1, -1))
    assert module.verdict(nested) == [[word, word] for word in module.verdict(state)]
