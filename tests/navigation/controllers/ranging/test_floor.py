"""Cells of floor: where they look, what they learn, and what they take for the end of the floor."""

from typing import NamedTuple

import numpy as np
import pytest
import torch

from ndtorch.navigation import RangingParams, Rect, StereoRig
from ndtorch.navigation.controllers.ranging._kernels_floor import FloorState, floor_step
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.floor_view import FloorParams, floor_view
from ndtorch.navigation.controllers.ranging.tables import floor_numbers
from ndtorch.navigation.stereo.strips import as_frames
from ndtorch.vision.nondirectional import NDMin

DT = 1 / 30
RIG = StereoRig(forward=0.15)
PARAMS = FloorParams()
VIEW = floor_view(RIG, PARAMS)
NUMBERS = floor_numbers(RIG, RangingParams(), VIEW, DT)
BANDS, BLOCKS = PARAMS.bands, PARAMS.blocks
LEVEL = 0.18


class Seen(NamedTuple):
    """Cells `[2, BANDS, BLOCKS]` that were seen free, and at which the floor ends."""

    free: np.ndarray
    ends: np.ndarray


def outputs(speed=0.5, curvature=0.0, level=LEVEL):
    """What floor gives in every cell, by the formula: image speed in pixels a step, then saturation."""
    down = 430 * 0.2 / VIEW.depth.numpy() ** 2 * speed * DT
    flow = np.hypot(down, 430 * speed * curvature * DT)
    return np.tile((level * (1 - np.exp(-flow / 1.2)))[:, None], (2, 1, BLOCKS)).astype(np.float32)


def step(cells, state, speed=0.5, curvature=0.0):
    """What is seen in cells `[2, BANDS, BLOCKS]`, or with what both cameras see `[4, BANDS, BLOCKS]`."""
    marks = np.empty((2, BANDS, BLOCKS), np.float32)
    after = floor_step(np.asarray(cells, np.float32), (speed, curvature), state, NUMBERS, marks)
    assert set(np.unique(marks)) <= {-0.5, 0.0, 1.0}
    return Seen(marks < 0, marks > 0), after


def learned(level=LEVEL, noise=0.0):
    return FloorState(np.full(BANDS, level, np.float32), noise, 100)


def test_the_cells_lie_where_their_pixels_see_the_floor():
    assert VIEW.cells == (Rect(302, 372, 80, 400), Rect(302, 372, 240, 560))
    assert VIEW.rects == (Rect(302, 372, 80, 640), Rect(302, 372, 0, 560))
    # The middle of the nearest band is row 369, 129.5 pixels below the middle of the image: 86 / 129.5 m.
    assert float(VIEW.depth[0]) == pytest.approx(86 / 129.5, rel=1e-6)
    assert float(VIEW.depth[-1]) == pytest.approx(86 / 64.5, rel=1e-6)
    # The outermost block of the left image is centered at column 99.5, 220 pixels to the left of the middle.
    assert float(VIEW.x[0, 0, 0]) == pytest.approx(0.15 + 86 / 129.5, rel=1e-6)
    assert float(VIEW.y[0, 0, 0]) == pytest.approx(0.15 + 86 / 129.5 * 220 / 430, rel=1e-5)
    torch.testing.assert_close(VIEW.y[1], -VIEW.y[0])
    # Both subfields see the floor ahead of the car.
    assert float(VIEW.y[0].min()) < -0.03


def test_motion_of_the_cells_against_its_definition():
    generator = torch.Generator().manual_seed(1)
    left, right = torch.rand(2, 3, 3, 480, 640, generator=generator)
    control, state, cells = RangingControl(RIG, DT), None, []
    for eyes in zip(left, right, strict=True):
        seen, state = control.see(as_frames(*eyes), state)
        cells.append(seen)
    cells = np.stack(cells)
    assert cells.shape == (3, 4, BANDS, BLOCKS)
    assert (cells[0, :2] == 0).all()
    for image, rect, k in ((left, VIEW.cells[0], 0), (right, VIEW.cells[1], 1)):
        motion, _ = NDMin(0.005, DT)(image.mean(-3, keepdim=True))
        for band, block in ((0, 0), (3, 5), (13, 7)):
            column = rect.left + 40 * block if k == 0 else rect.right - 40 * (block + 1)
            rows = slice(rect.bottom - 5 * (band + 1), rect.bottom - 5 * band)
            # Every second column of the subfield is read.
            pixels = motion[:, 0, rows, column : column + 40 : 2]
            wanted = 20 * pixels.abs().amax((-2, -1))
            # Light that all cells share is taken out: random frames have next to none.
            assert cells[:, k, band, block] == pytest.approx(wanted.numpy(), rel=0.02)


@pytest.mark.parametrize("speed", [0.5, -0.3])
@pytest.mark.parametrize("curvature", [0.0, 2.0])
def test_floor_is_free_at_any_speed(speed, curvature):
    seen, _ = step(outputs(abs(speed), curvature), learned(), speed, curvature)
    assert (seen.free == 1).all()
    assert (seen.ends == 0).all()


@pytest.mark.parametrize("factor", [0.0, 0.3, 4.0])
def test_a_cell_that_is_not_floor_ends_its_block(factor):
    cells = outputs()
    cells[0, 5, 2] *= factor
    seen, _ = step(cells, learned())
    assert np.argwhere(seen.ends).tolist() == [[0, 5, 2]]
    assert seen.free[0, :, 2].tolist() == [True] * 5 + [False] * 9
    assert seen.free.sum() == 2 * BANDS * BLOCKS - 9


def test_nothing_is_said_while_standing_or_below_the_noise():
    for seen, _ in (step(outputs(0.0), learned(), 0.0), step(outputs(), learned(noise=0.1))):
        assert seen.free.sum() == seen.ends.sum() == 0
    # Far floor drowns in noise before near floor does.
    seen, _ = step(outputs(), learned(noise=0.03))
    known = seen.free[0, :, 0].tolist()
    assert known == sorted(known, reverse=True)
    assert 0 < sum(known) < BANDS


@pytest.mark.parametrize("level", [0.05, 0.4])
def test_learns_its_floor_at_the_start(level):
    """A blank wall fills the right quarter of the view meanwhile."""
    state = FloorState(np.zeros(BANDS, np.float32), 0.0, 0)
    for n in range(15):
        speed = 0.0 if n < 3 else 0.5
        cells = outputs(speed, level=level)
        cells[1, :, :4] = 0.0
        seen, state = step(cells, state, speed)
        assert not (seen.free | seen.ends).any()
    assert float(state.level[0]) == pytest.approx(level, rel=0.2)
    seen, _ = step(outputs(level=level), state)
    assert (seen.free == 1).all()
