"""The scorer on maps whose worth is known, and what is kept of a drive."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from ndtorch.navigation import Grid, StereoRig
from ndtorch_robot.evaluation.metrics import (
    collision_places,
    collision_summary,
    coverage,
    edge_columns,
    peaks,
    score_map,
    spacing_error,
    true_edges,
    visible,
)
from ndtorch_robot.evaluation.record import Record
from ndtorch_robot.sim.plan import Plan, cylinder, ring
from ndtorch_robot.sim.procedural_textures import ALONG
from ndtorch_robot.sim.shapes import Box, trace
from ndtorch_robot.sim.simulation import Collision

RIG = StereoRig()


def doors():
    """A hallway with three niches 1.5 m apart; the doors are dark, all else is bright."""
    niches = [Box(2 + 1.5 * k, 1.0, 2.9 + 1.5 * k, 1.1, "door") for k in range(3)]
    outline, solids = trace([Box(0, -1, 9, 1), *niches])
    rows = (tuple((2 + 1.5 * k, 1.0) for k in range(3)),)
    plan = Plan("test", outline, solids, doors=rows, spacing=1.5)
    ends = np.roll(outline.array, -1, 0)
    profiles = [
        np.full(round(float(np.hypot(*(b - a))) * ALONG), 0.2 if kind == "door" else 0.8)
        for a, b, kind in zip(outline.array, ends, outline.kinds, strict=True)
    ]
    return plan, profiles


def blob(grid, places, spread=0.01):
    """A map with a small round blob at each place."""
    row, column = torch.meshgrid(torch.arange(grid.rows), torch.arange(grid.columns), indexing="ij")
    x, y = grid.center(row, column)
    return sum(torch.exp(-((x - a) ** 2 + (y - b) ** 2) / (2 * spread**2)) for a, b in places)


def test_edge_columns():
    profile = np.full(3 * ALONG, 0.5)
    profile[ALONG : 2 * ALONG] = 0.65
    assert edge_columns(profile, 0.08) == pytest.approx([1.0, 2.0], abs=0.01)
    assert len(edge_columns(profile, 0.2)) == 0
    assert len(edge_columns(np.linspace(0, 1, 3 * ALONG), 0.08)) == 0


def test_true_edges():
    plan, profiles = doors()
    edges = true_edges(plan, profiles)
    # Each niche: two corners at its front, and two at its back, where the door meets the jambs.
    assert len(edges.places) == 12
    assert edges.faint.sum() == 6
    assert set(np.round(edges.places[edges.faint][:, 1], 6)) == {1.0}


def test_visible():
    plan, profiles = doors()
    edges = true_edges(plan, profiles)
    poses = np.array([(x, 0.0, 0.0) for x in np.arange(0, 2.0, 0.05)])
    seen = edges.places[visible(plan, edges, poses, RIG)]
    assert {(round(x, 2), round(y, 2)) for x, y in seen} == {(2.0, 1.0), (2.9, 1.1), (3.5, 1.0)}
    assert not visible(plan, edges, np.add(poses, (0, 0, np.pi)), RIG).any()


def test_a_good_and_a_bad_map():
    plan, profiles = doors()
    grid = Grid(-0.5, 9.5, -1.5, 1.6)
    poses = np.array([(x, 0.0, 0.0) for x in np.arange(0, 7.0, 0.05)])
    edges = true_edges(plan, profiles)
    seen = edges.places[visible(plan, edges, poses, RIG)]
    perfect = score_map(blob(grid, seen), grid, plan, profiles, poses, RIG)
    assert perfect.precision == pytest.approx(1.0, abs=1e-3)
    assert perfect.recall == 1.0
    assert perfect.position_error_cm < 1.0
    assert perfect.spacing_error_percent < 0.7
    stretched = score_map(blob(grid, seen * (1.02, 1.0)), grid, plan, profiles, poses, RIG)
    assert stretched.spacing_error_percent == pytest.approx(2.0, abs=0.7)
    assert 3.0 < stretched.position_error_cm < 12.0
    wrong = score_map(blob(grid, [(4.0, 0.0)]), grid, plan, profiles, poses, RIG)
    assert wrong.precision == pytest.approx(0.0, abs=1e-6)
    assert wrong.recall == 0.0
    assert wrong.position_error_cm is None
    empty = score_map(torch.zeros(grid.rows, grid.columns), grid, plan, profiles, poses, RIG)
    assert empty == (None, None, None, None, None)


def test_a_map_of_places_along_walls():
    """It lies on surfaces, of which few places are edges; what hangs or lies below the cameras is none of them."""
    plan, profiles = doors()
    grid, poses = Grid(-0.5, 9.5, -1.5, 1.6), np.zeros((1, 3))
    along = [(x, -1.0) for x in (1.0, 2.0, 4.0)]
    wall = score_map(blob(grid, along), grid, plan, profiles, poses, RIG)
    assert wall.precision == pytest.approx(0.0, abs=1e-6)
    assert wall.surfaces == pytest.approx(1.0, abs=1e-3)
    beside = score_map(blob(grid, [*along, (4.0, -0.85)]), grid, plan, profiles, poses, RIG)
    assert beside.surfaces == pytest.approx(0.75, abs=0.01)
    for height, share in ((1.0, 1.0), (0.15, 0.0)):
        pole = replace(plan, solids=(*plan.solids, cylinder(4.0, 0.0, 0.05, height)))
        more = [*profiles, *(np.full(10, 0.5) for _ in pole.solids[-1].points)]
        found = score_map(blob(grid, [(4.0, 0.0)]), grid, pole, more, poses, RIG)
        assert found.surfaces == pytest.approx(share, abs=1e-3)


def test_peaks_and_spacing():
    plan, _ = doors()
    grid = Grid(0.0, 6.0, 0.0, 2.0)
    places = [(2.02, 1.0), (3.53, 1.02), (5.04, 1.0)]
    found = peaks(blob(grid, places), grid)
    distance = np.abs(found[:, None, 0] - np.array(places)[None, :, 0])
    assert distance.min(1).max() < 0.011  # two cells of one height count as two
    assert distance.min(0).max() < 0.011
    assert spacing_error(plan, np.array(places)) == pytest.approx(100 * 0.01 / 1.5, abs=0.05)
    assert spacing_error(plan, np.array(places[:1])) is None


def test_coverage():
    free = np.array([(x, 0.0) for x in np.arange(0.05, 10, 0.1)])
    path = np.array([(x, 0.0) for x in np.linspace(0, 4, 200)])
    assert coverage(free, path) == pytest.approx(0.5, abs=0.05)
    assert ring([(0, 0), (1, 0), (1, 1)]).area == 0.5


def test_collisions_by_place_and_by_who():
    collisions = [Collision(1.0, 0, 0, 0), Collision(2.0, 0.3, 0, 0), Collision(3.0, 0.9, 0, 0)]
    collisions += [Collision(4.0, 5, 5, 0, True, False), Collision(5.0, 5, 5, 0, True, True)]
    assert collision_places(collisions[:3]) == [(0, 0), (0.9, 0)]
    assert collision_summary(collisions) == {
        "collisions": 5,
        "collision_places": 2,
        "people_hit": 1,
        "hit_while_standing": 1,
    }


@pytest.mark.parametrize(
    ("commands", "turns"),
    [
        ([(0.5, 0), (0.5, 1), (0.4, 2), (0.5, 0), (0.5, 1)], 2),  # a turn that gets tighter is one
        ([(0.5, 1), (0.5, -1)], 2),
        ([(0.5, 0), (-0.3, 1.9), (-0.3, 1.6), (-0.3, 1.3), (0.5, 0)], 0),  # back on the way it came
        ([], 0),
    ],
)
def test_turns_are_counted_when_they_begin(commands, turns):
    made = object.__new__(Record)
    made.command = [np.array(pair) for pair in commands]
    assert made.turns == turns
