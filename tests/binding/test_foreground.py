"""The model foreground: masks and boxes of what moves, chunks of any length, states that come back, crossings."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

import ndtorch
from ndtorch.binding import BoundObject, load_state, save_state
from ndtorch.binding.models.foreground import ForegroundModel
from ndtorch.errors import InputError
from ndtorch.utils.tensors import leaves
from tests.foreground.passing_scenes import SIZE, ground, passing

STEPS = 50
FPS = 25.0


@cache
def film() -> Tensor:
    return (passing(STEPS, 4.0, first=6) * 255).round().to(torch.uint8)


def model(fps: float = FPS, **options: Any) -> ForegroundModel:
    loaded = ndtorch.load("foreground", size=SIZE, fps=fps, **options)
    assert isinstance(loaded, ForegroundModel)
    return loaded


def run(frames: Tensor, lengths: list[int] | None = None, **options: Any) -> tuple[list[Any], Any]:
    module, state, signals = model(**options), None, []
    with torch.inference_mode():
        for part in frames.split(lengths or [len(frames)]):
            out, state = module(part, state)
            signals.append(out)
    return signals, state


@cache
def whole() -> Any:
    return run(film())


def same(a: Any, b: Any) -> bool:
    one, other = leaves(a), leaves(b)
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


def squares(frames: int, *things: tuple[int, float, int, tuple[float, float, float]]) -> Tensor:
    """Squares of 24 pixels, each with its first left edge, step a frame, top and color."""
    video = ground().repeat(frames, 1, 1, 1)
    for left, step, top, color in things:
        for n in range(8, frames):
            at = round(left + step * (n - 8))
            first, last = max(0, at), min(SIZE[1], at + 24)
            if first < last:
                video[n, :, top : top + 24, first:last] = torch.tensor(color)[:, None, None]
    return video


@pytest.mark.slow
def test_what_passes_has_a_box_and_a_silhouette_at_every_frame() -> None:
    signals, state = whole()
    (thing,) = model().objects(state)
    assert (thing.color, thing.direction) == ("red", "right")
    assert len(thing.path) == len(thing.boxes)
    for (time, column, row), (left, top, right, bottom) in zip(thing.path, thing.boxes, strict=True):
        true = 4.0 * (round(time * FPS) - 6)
        # Before the ground is known, what it leaves behind is not yet told from it.
        if time > 0.8 and 1 <= true <= SIZE[1] - 25:
            assert (left, top, right, bottom) == pytest.approx((true, 44, true + 24, 68), abs=6)
            assert true - 1 <= column <= true + 25
            assert 44 <= row <= 68
    assert thing.velocity == pytest.approx((100.0, 0.0), abs=25)
    n = 30
    shape = signals[0].labels[n] == thing.track + 1
    true_shape = torch.zeros(SIZE, dtype=torch.bool)
    true_shape[44:68, 96:120] = True
    assert shape.shape == SIZE
    both = (shape & true_shape).sum() / (shape | true_shape).sum()
    assert float(both) > 0.75
    assert signals[0].inputs[n, thing.track].max() > 0.1


@pytest.mark.parametrize("lengths", [[1] * STEPS, [7, 30, 13]])
def test_chunks_of_any_length_give_the_same_to_the_last_bit(lengths: list[int]) -> None:
    signals, state = run(film(), lengths)
    assert same(state, whole()[1])
    assert torch.equal(torch.cat([part.labels for part in signals]), whole()[0][0].labels)


@pytest.mark.parametrize("at", [1, 30])
def test_a_state_is_saved_and_goes_on_bit_for_bit(tmp_path: Path, at: int) -> None:
    module = model()
    _, state = run(film()[:at])
    before = {name: part.clone() for name, part in leaves(state).items()}
    save_state(state, tmp_path / "state", {"source": "film"})
    again, _ = load_state(tmp_path / "state", module)
    assert same(again, state)
    with torch.inference_mode():
        assert same(module(film()[at:], again)[1], whole()[1])
        module(film()[at:], state)
    # A state that was used is as it was.
    assert all(torch.equal(part, before[name]) for name, part in leaves(state).items())


@pytest.mark.parametrize(("value", "name"), [(0.95, "white"), (0.03, "black")])
def test_what_has_no_hue_is_white_or_black(value: float, name: str) -> None:
    """On a film with tinted light."""
    frames = squares(30, (0, 4.0, 44, (value, value, value))) * torch.tensor([1.0, 0.95, 0.85])[:, None, None]
    (thing,) = model().objects(run((frames * 255).round().to(torch.uint8))[1])
    assert (thing.color, thing.color_name) == (name, name)
    assert not {"red", "green", "blue"} & thing.features.keys()
    assert thing.direction == "right"


def test_two_that_cross_keep_who_they_are() -> None:
    frames = squares(60, (0, 3.5, 40, (0.85, 0.2, 0.2)), (176, -3.5, 46, (0.2, 0.75, 0.2)))
    _, state = run(frames)
    things = model().objects(state)
    assert sorted((thing.color, thing.direction) for thing in things) == [("green", "left"), ("red", "right")]
    for thing in things:
        assert abs(thing.path[-1][1] - thing.path[0][1]) > 100


def test_what_stops_stays_an_object_and_what_does_not_travel_is_none() -> None:
    frames = squares(80, (0, 4.0, 44, (0.85, 0.2, 0.2)))
    frames[40:] = frames[40]
    # Something that appears and stays where it is.
    frames[20:, :, 80:104, 150:170] = 0.9
    _, state = run(frames)
    (thing,) = model().objects(state)
    assert thing.last_seen == pytest.approx(79 / FPS)
    assert [other.track for other in model().visible_objects(state)] == [thing.track]
    _, state = run(frames, min_travel_sizes=0.0)
    assert len(model().objects(state)) == 2


def test_a_thing_as_large_as_a_quarter_of_the_view_has_boxes_and_a_prefix_gives_the_same_rows() -> None:
    frames = ground().repeat(60, 1, 1, 1)
    for n in range(8, 60):
        frames[n, :, 16:96, max(0, 6 * n - 120) : max(0, 6 * n - 50)] = torch.tensor([0.8, 0.2, 0.2])[:, None, None]
    early, late = (model().objects(run(frames[:count])[1]) for count in (40, 60))
    (thing,) = late
    assert thing.last_seen == pytest.approx(59 / FPS, abs=0.3)
    for (time, *_), (left, top, right, bottom) in zip(thing.path, thing.boxes, strict=True):
        first = 6 * round(time * FPS) - 120
        if time > 0.8:
            true = torch.zeros(SIZE, dtype=torch.bool)
            true[16:96, max(0, first) : first + 70] = True
            inside = true[round(top) : round(bottom), round(left) : round(right)].sum()
            assert inside / (true.sum() + (right - left) * (bottom - top) - inside) > 0.7
    assert early[0].path == thing.path[: len(early[0].path)]
    assert early[0].boxes == thing.boxes[: len(early[0].path)]
    assert early[0].states == thing.states[: len(early[0].path)]


def crossings(count: int) -> Iterator[Tensor]:
    """Two squares that cross, again and again, 40 frames each time."""
    once = squares(40, (-24, 7.0, 20, (0.85, 0.2, 0.2)), (200, -7.0, 60, (0.2, 0.75, 0.2)))
    return iter([once] * count)


def test_lost_objects_are_taken_and_the_state_does_not_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is taken and what is left are the objects of a state from which nothing was taken."""
    monkeypatch.setattr("ndtorch.binding.models.foreground.MAX_PATH", 40)
    module, state, left, taken, sizes = model(), None, None, list[BoundObject](), list[int]()
    with torch.inference_mode():
        for frames in crossings(6):
            _, state = module(frames, state)
            _, left = module(frames, left)
            closed, left = module.take_closed(left)
            taken += closed
            sizes.append(sum(part.nbytes for part in leaves(left).values()))
    assert max(sizes[3:]) < 1.02 * max(sizes[1:3])
    assert same(left, state._replace(closed=left.closed))
    every = module.objects(state)
    assert len(every) >= 10
    for thing in every:
        parts = [one for one in (*taken, *module.objects(left)) if one.track == thing.track]
        assert len(parts) > 1
        assert sum((one.path for one in parts), ()) == thing.path
        assert {(one.color, one.direction) for one in parts} == {(thing.color, thing.direction)}
    with pytest.raises(InputError, match="batch"):
        module.take_closed((state, state))


def test_a_state_keeps_none_of_those_before_it_alive() -> None:
    """Two arrays of a still film do not change: a tensor of each that holds that of the state before would be a
    chain, as long as the film."""
    model, frames, state, alive = ndtorch.load("foreground", size=48), torch.full((1, 3, 48, 48), 0.5), None, []
    for _ in range(8):
        _, state = model(frames, state)
        gc.collect()
        alive.append(sum(type(thing) is Tensor for thing in gc.get_objects()))
    assert alive[-1] == alive[3]


def test_light_and_noise_are_no_objects() -> None:
    generator = torch.Generator().manual_seed(4)
    frames = ground().repeat(60, 1, 1, 1)
    frames[20:] *= torch.linspace(1, 1.5, 40)[:, None, None, None]
    frames = (frames + 0.03 * torch.randn(frames.shape, generator=generator)).clamp(0, 1)
    _, state = run(frames)
    assert model().objects(state) == []


@pytest.mark.parametrize("group", [2, 3])
def test_of_a_quick_camera_so_many_pictures_are_one(group: int) -> None:
    """Their mean is looked at when the last of them is in, whatever chunks they come in."""
    quick = film()[:12].repeat_interleave(group, 0)
    signals, state = run(quick, [5, 12 * group - 5], fps=group * FPS, max_fps=FPS)
    assert sum(len(part.time) for part in signals) == 12
    assert signals[-1].time[-1] == pytest.approx((12 * group - 1) / (group * FPS))
    before, after = run(film()[:12], max_fps=FPS)
    assert torch.equal(signals[-1].labels[-1], before[-1].labels[-1])
    torch.testing.assert_close(state.scene.background.mean, after.scene.background.mean)
