"""Scenes as the fields of a grid have them, and the objects that files find there."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from ndtorch.binding import ObjectFiles
from ndtorch.vision import VisualFeatures
from ndtorch_train.benchmark import retinotopic as local
from ndtorch_train.benchmark.bar_scenes import (
    DIRECTIONS,
    FPS,
    ORIENTATIONS,
    SIZE,
    SPEED,
    Restriction,
    Scene,
    draw_scene,
)
from ndtorch_train.benchmark.hard_scenes import HARD, arrived


def hill(width: float = 30.0) -> Tensor:
    """What a field sees of a bar falls off with the distance alone, `[DIRECTIONS, ORIENTATIONS, 8, POINTS, POINTS]`."""
    away = (torch.arange(local.POINTS) * local.STEP + local.CANVAS / 2) % local.CANVAS - local.CANVAS / 2
    line = torch.exp(-((away / width) ** 2))
    return (line[:, None] * line).expand(DIRECTIONS, ORIENTATIONS, 8, -1, -1)


def sums(scene: Scene, table: Tensor, seconds: float = 1.0, chunk: int = 20) -> Tensor:
    return torch.cat(list(local.local_sums([scene], seconds, table, chunk)), 1)[0]


def test_a_bar_is_felt_where_it_is_and_not_beyond_half_the_canvas() -> None:
    scene = draw_scene(3, Restriction(1))
    bar = replace(scene.bars[0], direction=0, start=(240.0, 100.0))
    seen = sums(Scene(3, (bar,)), hill())[..., 4:7].sum(-1)
    for step, second in ((0, 0.0), (19, 0.95)):
        row, column = divmod(int(seen[step].argmax()), local.FIELDS)
        assert row == round(100.5 / local.SPACING - 0.5)
        assert abs(column - ((240.5 + SPEED * second) / local.SPACING - 0.5)) <= 0.6
    away = [abs((n + 0.5) * local.SPACING - 100.5) for n in range(local.FIELDS)]
    far = [n for n, rows in enumerate(away) if min(rows, SIZE[0] - rows) > local.CANVAS / 2]
    assert far
    assert not seen[:, far].any()


def test_bars_add_up_and_chunks_change_nothing() -> None:
    scene = draw_scene(4, Restriction(3))
    table = hill()
    whole = sums(scene, table)
    alone = [sums(Scene(4, (bar,)), table) for bar in scene.bars]
    torch.testing.assert_close(whole, torch.stack(alone).sum(0))
    assert torch.equal(sums(scene, table, chunk=3), whole)


@pytest.mark.slow
def test_an_upright_bar_that_goes_right_is_seen_where_it_is() -> None:
    with torch.inference_mode():
        seen = local.measure_field(0, 0, VisualFeatures((local.CANVAS, local.CANVAS)))
    left, right, down, up, upright, *others, area = seen
    assert divmod(int(area.argmax()), local.POINTS) == (0, 0)
    assert float(right.sum()) > 2 * max(float(other.sum()) for other in (left, up, down))
    assert float(upright.sum()) > 1.3 * max(float(other.sum()) for other in others)
    away = (torch.arange(local.POINTS) * local.STEP + local.CANVAS / 2) % local.CANVAS - local.CANVAS / 2
    beyond = (away[:, None] ** 2 + away**2).sqrt() > 110
    assert float(area[beyond].max()) == pytest.approx(0, abs=1e-3 * float(area.max()))


def test_objects_are_read_after_the_samples_that_were_asked_for() -> None:
    """Two things a few fields apart: one goes right, upright and red; one up, lying and green."""
    t = torch.arange(140)
    signals = torch.zeros(1, len(t), local.FIELDS, local.FIELDS, 10)
    for (row, column), features, period in (((4, 4), (0, 4, 7), 17), ((11, 10), (1, 5, 8), 23)):
        light = 20 * (1.5 + torch.sin(t * 2 * torch.pi / period))
        for feature in features:
            signals[0, :, row, column, feature] = light
    files = ObjectFiles((local.FIELDS, local.FIELDS), local.SPACING, local.EVERY / FPS)
    with torch.inference_mode():
        readings = local.found(files, iter(signals.split(16, 1)), [1, 140])
    assert len(readings) == 2
    early, late = (reading[0] for reading in readings)
    assert len(early) == 0
    assert late.shape == (2, 10)


SETS = {hard.name: hard for hard in HARD}


def test_every_sample_of_the_fields_is_seen_once() -> None:
    """They were repeated five times, so that all went at a fifth of its speed."""
    kept = arrived(SETS["white 0.3"], [1], 100, 5)[0]
    assert (kept // 5).tolist() == list(range(20))
    lossy = SETS["12.5/s, 10 % lost"]
    late = arrived(lossy, [1], 8000, lossy.every)[0]
    assert len(late) == 1000
    assert 0.02 < (late[1:] == late[:-1]).double().mean() < 0.25


TEXTURED = local.RENDERED[0]


def test_a_ground_shows_where_no_bar_is_and_stays() -> None:
    scene = draw_scene(local.RENDERED_SEED, Restriction(1))
    first, last = local.OnGround(scene, TEXTURED).frames(0, 40)[[0, -1]]
    same = (first == last).all(0)
    assert 0.98 < same.double().mean() < 1
    assert torch.equal(first[:, same], local.ground(scene.seed)[:, same])


@pytest.mark.slow
def test_a_ground_without_bars_is_nothing() -> None:
    empty = local.OnGround(Scene(3, ()), TEXTURED, seconds=0.6)
    assert local.seen_in(empty).shape == (0, 10)
