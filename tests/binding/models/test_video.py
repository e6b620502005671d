"""The video model: chunks of any length, states that come back, objects over time, batches."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from torch import Tensor

import ndtorch
from ndtorch.binding import VideoModel, load_state, save_state
from ndtorch.errors import InputError
from ndtorch.tree import leaves
from tests.strategies import chunkings
from tests.vision.camera.passing_scenes import SIZE, passing

STEPS = 50


@cache
def film() -> Tensor:
    return (passing(STEPS, 4.0, first=4) * 255).round().to(torch.uint8)


def model(fps: float = 25.0, **options: Any) -> VideoModel:
    loaded = ndtorch.load("video", size=SIZE, fps=fps, **options)
    assert isinstance(loaded, VideoModel)
    return loaded


@cache
def whole() -> Any:
    with torch.inference_mode():
        return model()(film())


def same(a: Any, b: Any) -> bool:
    one, other = leaves(a), leaves(b)
    return one.keys() == other.keys() and all(
        torch.equal(one[name], other[name]) and one[name].dtype == other[name].dtype for name in one
    )


def test_what_passes_is_one_object_with_places_and_times() -> None:
    _, state = whole()
    (thing,) = model().objects(state)
    assert (thing.color, thing.direction) == ("red", "right")
    assert 0.1 < thing.first_seen < 1.0 < 1.5 < thing.last_seen <= (STEPS - 1) / 25
    times, columns, rows = zip(*thing.path, strict=True)
    assert list(times) == sorted(times)
    assert thing.place == (columns[-1], rows[-1])
    # Four pixels a frame, to the right.
    assert thing.velocity == pytest.approx((100.0, 0.0), abs=40)
    assert columns[-1] > columns[0] + 60
    assert [other.track for other in model().in_sight(state)] == [thing.track]


@settings(max_examples=4, deadline=None)
@given(lengths=chunkings(STEPS))
def test_chunks_of_any_length_give_the_same_to_the_last_bit(lengths: list[int]) -> None:
    module, state = model(), None
    with torch.inference_mode():
        for part in film().split(lengths):
            _, state = module(part, state)
    assert same(state, whole()[1])


@pytest.mark.parametrize("at", [1, 7, 30])
@torch.inference_mode()  # as `whole`: kernels round in another way than torch
@pytest.mark.slow
def test_a_state_is_saved_and_goes_on_bit_for_bit(tmp_path: Path, at: int) -> None:
    module = model()
    _, state = module(film()[:at])
    save_state(state, tmp_path / "state", {"source": "film"})
    again, about = load_state(tmp_path / "state", module)
    assert about == {"source": "film"}
    assert same(again, state)
    assert same(module(film()[at:], again)[1], whole()[1])


def test_a_state_before_the_first_time_step_too(tmp_path: Path) -> None:
    module = model(fps=90.0)
    signals, state = module(film()[:2])
    assert len(signals.time) == 0
    assert (state.network, state.tracker) == (None, None)
    assert (module.objects(state), module.verdict(state)) == ([], "static")
    save_state(state, tmp_path / "state")
    again, _ = load_state(tmp_path / "state", module)
    assert same(module(film()[2:], again)[1], module(film())[1])


@torch.inference_mode()
def test_a_batch_goes_through_film_by_film(tmp_path: Path) -> None:
    module, films = model(), torch.stack([film(), film().flip(-1)])
    signals, state = module(films[:, :20])
    signals, state = module(films[:, 20:], state)
    assert signals.outputs.shape == (2, STEPS - 20, 6, 10, 10)
    assert same(state[0], whole()[1])
    assert [[thing.direction for thing in trial] for trial in module.objects(state)] == [["right"], ["left"]]
    assert module.verdict(state) == [module.verdict(own) for own in state]
    assert module.weights(state).shape == (2, 10, 10)
    save_state(state, tmp_path / "state")
    assert same(load_state(tmp_path / "state", module)[0], state)


def test_verdicts() -> None:
    module = model()
    assert module.verdict(module(torch.zeros(5, 3, *SIZE))[1]) == "static"
    assert module.verdict(whole()[1]) == "learning"
    assert model(learn=False).weights(model(learn=False)(film())[1]).any().item() is False


def test_it_has_no_table_of_owners() -> None:
    with pytest.raises(InputError, match="objects of video are tracks and have no table"):
        model().table(whole()[1])
