"""From fields to detections, and from detections to tracks."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from ndtorch.binding import BoundObject
from ndtorch.binding.models.video import VideoModel, VideoSignals
from ndtorch.binding.tracking.detections import Detection, detections
from ndtorch.binding.tracking.tracker import Tracker, TrackerState
from ndtorch.tree import leaves

ROWS, COLUMNS, DT = 6, 10, 0.04
RED, GREEN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
Thing = tuple[Callable[[float], tuple[float, float] | None], tuple[float, float], tuple[float, float, float]]


def blank(steps: int) -> tuple[Tensor, Tensor, Tensor]:
    return torch.zeros(steps, ROWS, COLUMNS, 2), torch.zeros(steps, ROWS, COLUMNS), torch.zeros(steps, 60, 10)


def paint(things: list[Thing], steps: int = 100) -> tuple[VideoSignals, Tensor]:
    """Fields of things, each a path (row and column in fields by time, or None), a motion and a color."""
    motion, presence, outputs = blank(steps)
    r, c = torch.meshgrid(torch.arange(ROWS), torch.arange(COLUMNS), indexing="ij")
    for n in range(steps):
        for path, moves, color in things:
            place = path(n * DT)
            if place is None:
                continue
            weight = (1.2 - ((r - place[0]) ** 2 + (c - place[1]) ** 2).sqrt()).clamp_min(0)
            motion[n] += 0.01 * weight[..., None] * torch.tensor(moves)
            presence[n] += 0.3 * weight
            outputs[n, :, 7:] += weight.flatten()[:, None] * torch.tensor(color)
    times = torch.arange(steps, dtype=torch.float64) * DT
    signals = outputs.unflatten(1, (ROWS, COLUMNS))
    level = torch.zeros(steps, dtype=torch.int64)
    noise = torch.full((steps,), 0.01)
    cut, shades = torch.zeros(steps, dtype=torch.bool), torch.zeros(steps, ROWS, COLUMNS, 4)
    return VideoSignals(signals, signals, motion, presence, noise, level, times, cut, shades), outputs


def tracked(things: list[Thing], cuts: list[int], steps: int = 100) -> TrackerState:
    fields, _ = paint(things, steps)
    tracker, state = Tracker(DT, 16 / 9), None
    for first, last in zip([0, *cuts], [*cuts, steps], strict=True):
        state = tracker(VideoSignals(*(x[first:last] for x in fields)), state)
    assert state is not None
    return state


def found(things: list[Thing], steps: int = 100) -> list[BoundObject]:
    # In two pieces, as a run would.
    state = tracked(things, [33], steps)
    return [VideoModel()._bound(track) for track in Tracker(DT, 16 / 9).objects(state)]


def see(fields: VideoSignals, outputs: Tensor, n: int) -> list[Detection]:
    shown = outputs[n].double().numpy()
    return detections(fields.motion[n].double().numpy(), shown, shown, fields.presence[n].double().numpy(), 0.01, 0.1)


def test_two_things_in_different_places_are_two_detections() -> None:
    fields, outputs = paint([(lambda t: (1.0, 2.0), (1, 0), RED), (lambda t: (4.0, 7.0), (0, -1), GREEN)], 1)
    seen = see(fields, outputs, 0)
    assert len(seen) == 2
    for sight, row, column in zip(sorted(seen, key=lambda s: s.place), (1, 4), (2, 7), strict=True):
        assert sight.place == pytest.approx(((row + 0.5) / ROWS, (column + 0.5) / COLUMNS), abs=0.01)


@pytest.mark.parametrize(("color", "filled", "count"), [(RED, 0.9, 1), (GREEN, 0.9, 2), (RED, 0.0, 2)])
def test_ends_of_a_large_plain_thing_are_one_where_it_fills_what_lies_between(
    color: tuple[float, float, float], filled: float, count: int
) -> None:
    fields, outputs = paint([(lambda t: (1.0, 4.0), (0, 1), RED), (lambda t: (4.0, 4.0), (0, 1), color)], 1)
    fields.presence[0, 2:4, 4] = filled
    assert len(see(fields, outputs, 0)) == count


def test_faint_motion_is_none() -> None:
    fields, outputs = paint([(lambda t: (1.0, 2.0), (1e-3, 0), RED)], 1)
    assert see(fields, outputs, 0) == []


def test_crossing_things_keep_who_they_are() -> None:
    things: list[Thing] = [
        (lambda t: (2.0, 9 * t / 4), (1, 0), RED),
        (lambda t: (2.6, 9 - 9 * t / 4), (-1, 0), GREEN),
    ]
    objects = found(things)
    assert [(thing.color, thing.direction) for thing in sorted(objects, key=lambda o: o.color)] == [
        ("green", "left"),
        ("red", "right"),
    ]
    for thing in objects:
        assert thing.first_seen == pytest.approx(0.3, abs=0.1)
        assert thing.last_seen == pytest.approx(3.96, abs=0.1)


def test_a_thing_that_is_hidden_for_a_second_is_one() -> None:
    def path(t: float) -> tuple[float, float] | None:
        return None if 1.5 < t < 2.5 else (3.0, 9 * t / 4)

    objects = found([(path, (1, 0), RED)])
    assert [thing.direction for thing in objects] == ["right"]
    assert objects[0].last_seen > 3.5


def test_what_flickers_in_place_or_passes_in_a_moment_is_none() -> None:
    assert found([(lambda t: (3.0, 4.0), (1, 0), RED)]) == []
    assert found([(lambda t: (3.0, 30 * t) if 1 < t < 1.2 else None, (1, 0), RED)]) == []
    assert found([]) == []


def test_pieces_of_any_length_give_the_same_to_the_last_bit() -> None:
    things: list[Thing] = [
        (lambda t: (2.0, 9 * t / 4), (1, 0), RED),
        (lambda t: (2.6, 9 - 9 * t / 4) if t < 2 else None, (-1, 0), GREEN),
    ]
    whole = leaves(tracked(things, []))
    for cuts in ([1], [40, 41, 90], list(range(1, 100))):
        parts = leaves(tracked(things, cuts))
        assert parts.keys() == whole.keys()
        assert all(torch.equal(parts[name], whole[name]) for name in whole)
    assert len(whole["closed.number"]) == 1


def test_a_state_that_was_used_is_as_it_was() -> None:
    fields, _ = paint([(lambda t: (2.0, 9 * t / 4), (1, 0), RED)])
    tracker = Tracker(DT, 16 / 9)
    state = tracker(VideoSignals(*(x[:60] for x in fields)))
    before = {name: part.clone() for name, part in leaves(state).items()}
    tracker(VideoSignals(*(x[60:] for x in fields)), state)
    assert all(torch.equal(part, before[name]) for name, part in leaves(state).items())
