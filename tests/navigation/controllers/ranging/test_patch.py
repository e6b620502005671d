"""The remembered patch against a dictionary that knows nothing of tensors; free arcs against moved rectangles."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.errors import InputError
from ndtorch.navigation import Pose
from ndtorch.navigation.controllers.ranging.arcs import Body, arc_table, free_travel
from ndtorch.navigation.controllers.ranging.patch import (
    PatchParams,
    add_evidence,
    cell_numbers,
    empty_patch,
    move_patch,
)

PARAMS = PatchParams(cell=0.1, size=32)
NUMBERS = torch.arange(32.0)


def pose(x=0.0, y=0.0, heading=0.0):
    return Pose(*(torch.tensor(float(v), dtype=torch.float64) for v in (x, y, heading)))


def world(place, here):
    """A place of the body frame in the world, by complex numbers."""
    at = complex(here.x, here.y) + complex(*place) * complex(math.cos(here.heading), math.sin(here.heading))
    return at.real, at.imag


@given(st.lists(st.tuples(*[st.floats(-0.9, 0.9)] * 3, st.floats(-1.4, 1.4), st.floats(-1.4, 1.4)), max_size=25))
@settings(max_examples=60, deadline=None)
def test_remembers_what_a_dictionary_would(moves):
    """Drive about, add evidence, and compare all that is near the car with a dictionary of world cells."""
    here = pose(0.05, 0.05)
    patch, truth = empty_patch(here, PARAMS), {}
    keep = torch.tensor(0.9, dtype=torch.float64)
    for dx, dy, turn, bx, by in moves:
        here = pose(float(here.x) + dx, float(here.y) + dy, float(here.heading) + turn)
        patch = move_patch(patch, here, NUMBERS.double(), keep, PARAMS)
        middle = math.floor(float(here.x) / 0.1), math.floor(float(here.y) / 0.1)
        inside = lambda c, m=middle: all(-16 < c[k] - m[k] <= 16 for k in (0, 1))  # noqa: E731
        truth = {cell: 0.9 * value for cell, value in truth.items() if inside(cell)}
        place = torch.tensor([[bx], [by]], dtype=torch.float64) * 0.7
        wx, wy = world((bx * 0.7, by * 0.7), here)
        if min(wx / 0.1 % 1, -wx / 0.1 % 1, wy / 0.1 % 1, -wy / 0.1 % 1) < 1e-6:
            continue  # on the border of two cells rounding decides
        patch = add_evidence(patch, cell_numbers(place, here, PARAMS), torch.ones(1, dtype=torch.float64), PARAMS)
        cell = math.floor(wx / 0.1), math.floor(wy / 0.1)
        truth[cell] = truth.get(cell, 0.0) + 1.0
        for (cx, cy), value in truth.items():
            if all(abs(c - m) <= 14 for c, m in zip((cx, cy), middle, strict=True)):
                found = float(patch.evidence[(cx % 32) * 32 + cy % 32])
                assert found == pytest.approx(value, abs=1e-9)


def test_forgets_what_it_has_left_behind():
    patch = empty_patch(pose(), PARAMS)
    one = torch.tensor(1.0, dtype=torch.float64)
    patch = add_evidence(
        patch, cell_numbers(torch.tensor([[0.55], [0.0]]).double(), pose(), PARAMS), one.view(1), PARAMS
    )
    for x, left in ((-0.8, 1), (-1.5, 0), (0.0, 0)):
        patch = move_patch(patch, pose(x), NUMBERS.double(), one, PARAMS)
        assert int((patch.evidence > 0).sum()) == left


def test_evidence_is_limited():
    number = torch.tensor([5, 5, 7])
    patch = empty_patch(pose(), PARAMS)
    patch = add_evidence(patch, number, torch.tensor([4.0, 4.0, -9.0]).double(), PARAMS)
    assert patch.evidence[[5, 7]].tolist() == [5.0, -2.0]


def test_a_patch_for_each_car():
    here = Pose(*torch.tensor([[0.3, -4.2], [1.0, 0.2], [0.5, -2.0]]))
    places = torch.tensor([[0.5, 0.2], [-0.3, 0.9]])
    both = add_evidence(
        empty_patch(here, PARAMS), cell_numbers(places.expand(2, 2, 2), here, PARAMS), torch.ones(2, 2), PARAMS
    )
    for k in range(2):
        mine = Pose(*(part[k] for part in here))
        alone = add_evidence(empty_patch(mine, PARAMS), cell_numbers(places, mine, PARAMS), torch.ones(2), PARAMS)
        assert torch.equal(alone.evidence, both.evidence[k])


BODY = Body(length=0.25, width=0.18, room=0.07)
ARCS = [(0.0, 1), (1.0, 1), (-2.0, 1), (0.0, -1), (2.0, -1)]
TABLE = arc_table(ARCS, BODY, 1.6, 0.08)


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


def travel(x, y, around=(0.0,)):
    """What `free_travel` says of blocked cells of 8 cm: that of one place, or of those so far around it."""
    params = PatchParams(cell=0.08, size=64)
    here = pose(0.013, -0.02, 0.3)
    blocked = torch.tensor([(x + dx, y + dy) for dx in around for dy in around], dtype=torch.float64).T
    number = cell_numbers(blocked, here, params).unique()
    patch = add_evidence(
        empty_patch(here, params), number, torch.full((len(number),), 3.0, dtype=torch.float64), params
    )
    places = torch.stack((TABLE.x, TABLE.y)).double()
    found = patch.evidence.gather(-1, cell_numbers(places, here, params))
    return free_travel(found, TABLE, torch.tensor([2.0, 2.0]))[0]


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


def test_free_travel_of_a_wall_ahead():
    found = travel(1.0, 0.0)
    # Bumper and room reach 0.32 m ahead.
    assert float(found[0]) == pytest.approx(0.68, abs=0.12)
    assert found[3:].tolist() == pytest.approx([1.6, 1.6])


def test_what_was_not_seen_free_stops_the_bumper_only():
    evidence = torch.full((len(TABLE.x),), -1.0)
    limits = torch.tensor([1.0, -0.1])
    assert free_travel(evidence, TABLE, limits).flatten().tolist() == pytest.approx([1.6] * 10)
    # Nothing is known 0.8 m and more ahead of the middle: the bumper and its room get there after 0.48 m.
    evidence = torch.where(TABLE.x >= 0.8, 0.0, -1.0)
    free, seen = free_travel(evidence, TABLE, limits)
    assert free.tolist() == pytest.approx([1.6] * 5)
    assert float(seen[0]) == pytest.approx(0.4)
    assert seen[3:].tolist() == pytest.approx([1.6, 1.6])
    # Beside the flanks nothing need be known.
    evidence = torch.where(TABLE.x.abs() < 0.3, 0.0, -1.0)
    assert float(free_travel(evidence, TABLE, limits)[1, 0]) == pytest.approx(1.6)


def test_bad_parameters():
    with pytest.raises(InputError, match="power of two"):
        PatchParams(size=48)
    with pytest.raises(InputError, match="cell"):
        PatchParams(cell=0.0)
    with pytest.raises(InputError, match="lifetime"):
        PatchParams(lifetime=0.0)
    with pytest.raises(InputError, match="width"):
        Body(width=0.0)
    with pytest.raises(InputError, match="longest"):
        arc_table(ARCS, BODY, 0.05, 0.08)


def test_arcs_are_followed_by_a_step_of_a_cell_where_none_is_named() -> None:
    """A step longer than a cell of the patch could miss one."""
    table = arc_table(ARCS, BODY, 1.6)
    assert table.step <= PatchParams().cell
    assert torch.equal(table.x, TABLE.x)


@pytest.mark.parametrize("direction", [1, -1])
def test_places_of_the_outline_are_at_most_a_step_apart_ahead_and_two_at_the_sides(direction: int) -> None:
    """What goes along a flank is looked at at every step of the way, so two steps are near enough there."""
    table = arc_table([(0.0, direction)], BODY, 1.6, 0.08)
    x, y = table.x.view(table.steps, -1)[0], table.y.view(table.steps, -1)[0]
    ahead, wide = BODY.length + BODY.room, BODY.width + BODY.room
    assert x[: table.leading].tolist() == pytest.approx([direction * (0.08 + ahead)] * table.leading)
    assert y[: table.leading].tolist() == pytest.approx(torch.linspace(-wide, wide, 8).tolist(), abs=1e-6)
    for flank, side in zip(x[table.leading :].view(2, -1), (wide, -wide), strict=True):
        assert (direction * flank - 0.08).tolist() == pytest.approx([-ahead, -ahead / 2, 0.0, ahead / 2], abs=1e-6)
        assert bool((y[table.leading :].view(2, -1) == torch.tensor(side)).any(-1).any())
