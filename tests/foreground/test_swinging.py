"""What swings at the edge of the picture is told from what passes, and its noise is learned."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ndtorch.foreground._kernels import SWING_PACE
from ndtorch.foreground.background import BackgroundModel, BackgroundParams, smoothing_factor, update_background
from ndtorch.foreground.swinging import PASSED, RETURNED, SWINGING, start, update_swinging

SIZE, DT, WIDE = (80, 120), 0.08, 20


def watch(columns: Any, rows: slice) -> Any:
    """The state after a bar of `WIDE` columns was at these places, step by step."""
    state = start(*SIZE)
    for n, column in enumerate(columns):
        mask = np.zeros((SIZE[0], SIZE[1] + 2 * WIDE), np.uint8)
        mask[rows, max(0, column + WIDE) : max(0, column + 2 * WIDE)] = 1
        update_swinging(state, np.ascontiguousarray(mask[:, WIDE:-WIDE]), n, DT)
    return state


def swing(seconds: float) -> Any:
    """Columns of a bar that covers half of its way at a time, period 2.4 s."""
    return np.round(50 + 10 * np.sin(2 * np.pi / 2.4 * DT * np.arange(round(seconds / DT)))).astype(int)


@pytest.mark.parametrize("mirror", [False, True])
def test_what_swings_leaves_as_it_came_and_what_passes_does_not(mirror: bool) -> None:
    columns, step = swing(12), 3
    state = watch(100 - columns if mirror else columns, slice(0, 60))
    marked = np.flatnonzero(state[SWINGING][15])
    # It covers columns 40 to 79, two of them a pixel; what is near belongs to it.
    assert state[SWINGING][:30].any()
    assert not state[SWINGING][35:].any()
    assert set(range(20, 40)) <= set(marked.tolist()) <= set(range(15, 45))
    assert state[RETURNED].sum() > 5 * state[PASSED].sum()
    passing = np.tile(np.arange(-WIDE, SIZE[1] + 1, step), 4)
    state = watch(passing[::-1] if mirror else passing, slice(0, 60))
    assert state[PASSED].sum() > 5 * state[RETURNED].sum()
    assert not state[SWINGING].any()


def test_only_what_reaches_beyond_the_picture_covers_it() -> None:
    assert watch(swing(12), slice(0, 60))[SWINGING].any()
    assert not watch(swing(12), slice(10, 70))[SWINGING].any()


def test_where_it_swings_noise_is_learned_under_objects_and_nowhere_else() -> None:
    """A share of the distance each step, which shrinks as the background follows."""
    p, image = BackgroundParams(), np.full((3, *SIZE), 0.4, np.float32)
    model = BackgroundModel.start(image, p)
    model.initialised[:], model.frames, model.deviation[:] = 1, 1000, 0
    model.swinging[SWINGING, :, :30] = 1
    other, noise = image + np.float32(0.3), np.full(3, 0.006, np.float32)
    for _ in range(5):
        update_background(model, other, noise, np.ones(SIZE, np.float32), DT, p)
    left, right = model.deviation[0, :, :60], model.deviation[0, :, 60:]
    share = SWING_PACE * smoothing_factor(p.tau_noise, DT)
    gap = 1 - p.object_learning_ratio * smoothing_factor(p.tau_background, DT)
    expected = sum(share * (1 - share) ** (4 - n) * 0.3 * gap**n for n in range(5))
    assert left == pytest.approx(expected, rel=1e-4)
    assert right.max() < 0.01 * expected
