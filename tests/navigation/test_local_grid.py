"""The local grid against a dictionary of world cells; free distances along arcs against moved rectangles."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.navigation import Pose
from ndtorch.navigation.body import Body
from ndtorch.navigation.local_grid import (
    LocalGridParams,
    cell_index,
    empty_grid,
    free_distances,
    motion_primitives,
    move_grid,
)

PARAMS = LocalGridParams(cell_m=0.1, size_cells=32)


def cells_at(pose, x, y, params):
    """Numbers of the cells that hold points of the body frame."""
    points = (np.asarray(part, np.float32) for part in (x, y))
    return cell_index(*points, pose, params.cell_m, params.size_cells)


def world(place, here):
    """A place of the body frame in the world, by complex numbers."""
    at = complex(here.x, here.y) + complex(*place) * complex(math.cos(here.heading), math.sin(here.heading))
    return at.real, at.imag


@given(st.lists(st.tuples(*[st.floats(-0.9, 0.9)] * 3, st.floats(-1.4, 1.4), st.floats(-1.4, 1.4)), max_size=25))
@settings(max_examples=60, deadline=None)
def test_remembers_what_a_dictionary_would(moves):
    """Drive about, add evidence, and compare all that is near the car with a dictionary of world cells."""
    here = Pose(0.05, 0.05, 0.0)
    grid, truth = empty_grid(here.x, here.y, PARAMS), {}
    for dx, dy, turn, bx, by in moves:
        here = Pose(here.x + dx, here.y + dy, here.heading + turn)
        border = [abs(v / 0.1 - round(v / 0.1)) < 1e-4 for v in here[:2]]
        if any(border):
            continue  # on the border of two cells rounding decides
        grid = move_grid(grid, tuple(here), PARAMS.cell_m, 0.9)
        middle = math.floor(here.x / 0.1), math.floor(here.y / 0.1)
        inside = lambda c, m=middle: all(-16 < c[k] - m[k] <= 16 for k in (0, 1))  # noqa: E731
        truth = {cell: 0.9 * value for cell, value in truth.items() if inside(cell)}
        wx, wy = world((bx * 0.7, by * 0.7), here)
        if not any(abs(v / 0.1 - round(v / 0.1)) < 1e-4 for v in (wx, wy)):
            grid.evidence.reshape(-1)[cells_at(tuple(here), [bx * 0.7], [by * 0.7], PARAMS)] += 1
            cell = math.floor(wx / 0.1), math.floor(wy / 0.1)
            truth[cell] = truth.get(cell, 0.0) + 1.0
        for (cx, cy), value in truth.items():
            if all(abs(c - m) <= 14 for c, m in zip((cx, cy), middle, strict=True)):
                assert grid.evidence[cx % 32, cy % 32] == pytest.approx(value, abs=1e-5)


BODY = Body(length_m=0.5, width_m=0.36)
ARCS = [(0.0, 1), (1.0, 1), (-2.0, 1), (0.0, -1), (2.0, -1)]
TABLE = motion_primitives(ARCS, BODY, 0.07, 1.6, 0.08)


def touched(curvature, direction, travel, x, y):
    """Whether the car with its room, having gone so far along an arc, covers a place: by its pose there."""
    s = direction * travel
    heading = curvature * s
    cx, cy = (math.sin(heading) / curvature, (1 - math.cos(heading)) / curvature) if curvature else (s, 0.0)
    along = (x - cx) * math.cos(heading) + (y - cy) * math.sin(heading)
    across = -(x - cx) * math.sin(heading) + (y - cy) * math.cos(heading)
    return abs(along) <= 0.32 and abs(across) <= 0.25


def first_touch(curvature, direction, x, y):
    """Metres until the place is covered, by driving 5 mm at a time."""
    return next((n / 200 for n in range(321) if touched(curvature, direction, n / 200, x, y)), 1.6)


def free(evidence, blocked=1.0, unknown=-0.1):
    """`free_distances` of evidence at each place of the table."""
    return free_distances(
        evidence.astype(np.float32)[None], np.arange(len(TABLE.x), dtype=np.int32), TABLE, blocked, unknown
    )


def travel(x, y, around=(0.0,)):
    """The free distance with blocked cells of 8 cm: that of one place, or of those so far around it."""
    params, here = LocalGridParams(cell_m=0.08, size_cells=64), (0.013, -0.02, 0.3)
    grid = empty_grid(here[0], here[1], params)
    blocked = np.array([(x + dx, y + dy) for dx in around for dy in around]).T
    grid.evidence.reshape(-1)[cells_at(here, *blocked, params)] = 3
    at = cell_index(TABLE.x, TABLE.y, here, params.cell_m, params.size_cells)
    return free_distances(grid.evidence, at, TABLE, 2.0, 2.0)[0]


@given(st.floats(-1.4, 1.6), st.floats(-1.3, 1.3))
@settings(max_examples=60, deadline=None)
def test_free_travel_against_moved_rectangles(x, y):
    """Up to a step and the diagonal of a cell, 8 cm each; what the car covers at the start is left out.

    Four cells are blocked. A cell by itself can lie between the places that the table of arcs looks at: 8 of 6500
    single cells are missed.
    """
    if abs(x) < 0.55 and abs(y) < 0.45:
        return
    found = travel(x, y, (-0.04, 0.04))
    for k, (curvature, direction) in enumerate(ARCS):
        # A cell is blocked as a whole: all places within its diagonal may be what stops the car.
        offsets = (-0.155, -0.08, 0.0, 0.08, 0.155)
        lengths = [first_touch(curvature, direction, x + dx, y + dy) for dx in offsets for dy in offsets]
        assert min(lengths) - 0.081 <= float(found[k]) <= max(lengths) + 0.081


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_a_wall_on_the_border_of_cells_is_not_missed(heading):
    """The outline reaches four cells ahead: at every step its places lie on borders, too."""
    params, here, y = LocalGridParams(cell_m=0.08, size_cells=64), (0.0, 0.0, heading), np.linspace(-0.2, 0.2, 11)
    at = cell_index(TABLE.x, TABLE.y, here, params.cell_m, params.size_cells)
    for wall in 0.08 * np.arange(6, 20):
        grid = empty_grid(0.0, 0.0, params)
        grid.evidence.reshape(-1)[cells_at(here, np.full(11, wall), y, params)] = 3
        assert wall - 0.401 <= float(free_distances(grid.evidence, at, TABLE, 2.0, 2.0)[0, 0]) <= wall - 0.319


def test_what_was_not_seen_free_stops_the_bumper_ahead_and_the_whole_outline_backward():
    nothing = np.full(len(TABLE.x), -1.0)
    assert free(nothing).ravel().tolist() == pytest.approx([1.6] * 10)
    # Nothing is known 0.8 m and more ahead of the middle: the bumper and its room get there after 0.48 m.
    all_free, seen = free(np.where(TABLE.x >= 0.8, 0.0, -1.0))
    assert all_free.tolist() == pytest.approx([1.6] * 5)
    assert float(seen[0]) == pytest.approx(0.4)
    assert seen[3:].tolist() == pytest.approx([1.6, 1.6])
    # Beside the flanks nothing need be known ahead; no camera looks backward.
    beside = free(np.where(np.abs(TABLE.x) < 0.3, 0.0, -1.0))[1]
    assert (float(beside[0]), *beside[3:].tolist()) == pytest.approx((1.6, 0.0, 0.0))
