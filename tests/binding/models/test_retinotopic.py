"""The retinotopic model: local fields and windows in a row, batches, and objects with places."""

from __future__ import annotations

import pytest
import torch

import ndtorch
from ndtorch.binding import ObjectFiles, RetinotopicModel
from ndtorch.scenes import equal_bars
from ndtorch.vision import LocalFeatures, VisualFeatures

SIZE = (64, 64)


def model() -> RetinotopicModel:
    loaded = ndtorch.load("retinotopic", size=SIZE, along=8)
    assert isinstance(loaded, RetinotopicModel)
    return loaded


def noise(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, 3, *SIZE, generator=torch.Generator().manual_seed(0))


def test_signals_are_those_of_the_parts_in_a_row() -> None:
    frames, module = noise(12), model()
    signals, state = module(frames)
    eyes = LocalFeatures(VisualFeatures(SIZE), 8)
    fields, _ = eyes(frames)
    number, end = ObjectFiles((8, 8), 8.0)(fields)
    assert torch.equal(signals.fields, fields)
    assert torch.equal(signals.number, number)
    assert torch.equal(state.windows.place, end.place)
    assert signals.outputs.shape == (12, 8, 8, 10)
    assert signals.time.tolist() == pytest.approx([0.01 * n for n in range(12)])


def test_a_batch_is_that_many_trials() -> None:
    module, frames = model(), noise(2, 6)
    _, state = module(frames)
    assert module.objects_batch(state) == [[], []]
    assert module.verdict(state) == ["learning", "learning"]
    assert module.verdict(module(torch.zeros(2, 3, 3, *SIZE))[1]) == ["static", "static"]


def test_an_object_says_when_it_was_seen() -> None:
    module = model()
    signals, state = module(noise(12))
    windows = state.windows
    one = torch.zeros_like(windows.open)
    one[3] = True
    age = module.config.tracking.confirm + 0.04
    state = state._replace(windows=windows._replace(open=one, age=age * one.float(), unseen=0.03 * one.float()))
    (thing,) = module.objects(state)
    now = float(signals.time[-1])
    assert thing.track == 3
    assert thing.last_seen == pytest.approx(now - 0.03)
    assert thing.first_seen == pytest.approx(now - age)


@pytest.mark.slow
def test_three_equal_bars_are_three_objects() -> None:
    """Claim C8 [C §5.5.2]: wide-field sums see one object, fields see three."""
    module, state = ndtorch.load("retinotopic"), None
    with torch.inference_mode():
        for frames in equal_bars(seconds=8).chunks(8):
            _, state = module(frames, state)
    found = module.objects(state)
    assert len(found) == 3
    assert len({frozenset(thing.features) for thing in found}) == 1
    assert module.verdict(state) == "stable"
    for thing in found:
        assert thing.place is not None
        assert all(0 <= at <= 500 for at in thing.place)
        assert 0 <= thing.first_seen < 3 < 7 < thing.last_seen < 8
    assert module.visible_objects(state) != []
