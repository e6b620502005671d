"""Scenes for fields, superposed of single bars: what is far away is not felt, and bars add up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.vision import VisualFeatures
from ndtorch_train.score import local_bars as local
from ndtorch_train.score.scenes import SIZE, SPEED, Restriction, Scene, draw_scene
from ndtorch_train.score.single_bars import DIRECTIONS, ORIENTATIONS


def hill(width: float = 30.0) -> Tensor:
    """What a field sees of a bar falls off with the distance alone, `[DIRECTIONS, ORIENTATIONS, 8, POINTS, POINTS]`."""
    away = (torch.arange(local.POINTS) * local.STEP + local.CANVAS / 2) % local.CANVAS - local.CANVAS / 2
    line = torch.exp(-((away / width) ** 2))
    return (line[:, None] * line).expand(DIRECTIONS, ORIENTATIONS, 8, -1, -1)


def sums(scene: Scene, table: Tensor, seconds: float = 1.0, chunk: int = 20) -> Tensor:
    return torch.cat(list(local.local_sums([scene], seconds, table, chunk)), 1)[0]


def test_offsets_between_two_points_are_weighed() -> None:
    """A response that rises evenly with the offset is read exactly at every offset."""
    plane = torch.arange(local.POINTS).expand(1, local.POINTS, local.POINTS).float() * local.STEP
    fields = (torch.arange(local.FIELDS) + 0.5) * local.SPACING - 0.5
    columns = fields[3] + torch.tensor([0.0, 1.0, 7.25, 61.5])
    seen = local.at_offsets(plane, fields[5].expand(4), columns, fields)
    torch.testing.assert_close(seen[:, 5, 3, 0], torch.tensor([0.0, 1.0, 7.25, 61.5]), rtol=0, atol=1e-3)


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


def test_the_scene_is_a_torus() -> None:
    scene = draw_scene(5, Restriction(1))
    column, row = scene.bars[0].start
    moved = replace(scene.bars[0], start=(column + 3 * local.SPACING - SIZE[1], row + 2 * local.SPACING))
    table = hill()
    there, here = sums(Scene(5, (moved,)), table), sums(scene, table)
    torch.testing.assert_close(there, here.roll((2, 3), (1, 2)), rtol=1e-3, atol=1e-4)


def test_the_table_is_measured_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def measured(direction: int, orientation: int, features: VisualFeatures) -> Tensor:
        asked.append((direction, orientation))
        return torch.full((8, local.POINTS, local.POINTS), float(len(asked)))

    monkeypatch.setattr(local, "measure", measured)
    monkeypatch.setattr(local, "VisualFeatures", lambda size: None)
    table = local.local_bars(tmp_path / "kept")
    assert asked == [(d, o) for d in range(DIRECTIONS) for o in range(ORIENTATIONS)]
    assert torch.equal(local.local_bars(tmp_path / "kept"), table)
    assert len(asked) == DIRECTIONS * ORIENTATIONS
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"local_bars_16_350_5.npy cannot be written"):
        local.local_bars(tmp_path / "file")


@pytest.mark.slow
def test_an_upright_bar_that_goes_right_is_seen_where_it_is() -> None:
    with torch.inference_mode():
        seen = local.measure(0, 0, VisualFeatures((local.CANVAS, local.CANVAS)))
    left, right, down, up, upright, *others, area = seen
    assert divmod(int(area.argmax()), local.POINTS) == (0, 0)
    assert float(right.sum()) > 2 * max(float(other.sum()) for other in (left, up, down))
    assert float(upright.sum()) > 1.3 * max(float(other.sum()) for other in others)
    away = (torch.arange(local.POINTS) * local.STEP + local.CANVAS / 2) % local.CANVAS - local.CANVAS / 2
    beyond = (away[:, None] ** 2 + away**2).sqrt() > 110
    assert float(area[beyond].max()) == pytest.approx(0, abs=1e-3 * float(area.max()))
