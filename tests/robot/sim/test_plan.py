"""Plans: arenas by name and seed, rooms to walls, ray casting, free places, files."""

import math

import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch_robot.sim.arenas import ARENAS, DOOR_SPACING, load_arena
from ndtorch_robot.sim.places import Places
from ndtorch_robot.sim.plan import Plan, Ring, inside, ring
from ndtorch_robot.sim.tracing import Box, trace

SQUARE = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)]


@pytest.mark.parametrize("seed", [0, 7])
@pytest.mark.parametrize("name", ARENAS)
def test_arenas(name, seed):
    plan = load_arena(name, seed)
    assert plan == load_arena(name, seed)
    assert plan.name == name
    assert plan.outline.area > 0
    assert all(solid.area < 0 for solid in plan.solids)
    places = Places(plan)
    assert len(places.points) > 20
    assert (plan.clearance(places.points) > 0.4).all()
    x, y, heading = places.any(np.random.default_rng(seed))
    assert places.lengths(x, y, np.array([heading]))[0] > 1.0
    (ax, ay), (bx, by) = places.walk(np.random.default_rng(seed), (x, y))
    assert 0.3 < math.hypot(bx - ax, by - ay) < 4.001


@pytest.mark.parametrize("name", ["hallway", "loop", "room", "office", "random"])
def test_seeds_differ(name):
    assert load_arena(name, 1) != load_arena(name, 2)


def test_hallway_doors():
    plan = load_arena("hallway", 3)
    corners = {(round(x, 6), round(y, 6)) for r in plan.rings for x, y in r.points}
    assert len(plan.doors) == 12
    for row in plan.doors:
        assert all((round(x, 6), round(y, 6)) in corners for x, y in row)
        assert np.allclose(np.diff([x for x, _ in row]), DOOR_SPACING)
    kinds = plan.outline.kinds
    assert kinds.count("door") == 18
    assert kinds.count("jamb") == 36


def test_curve_size():
    plan = load_arena("curve")
    assert np.hypot(*plan.outline.array.T) == pytest.approx(12.0)
    assert np.hypot(*plan.solids[0].array.T) == pytest.approx(9.6)


def test_tracing_rooms_with_a_hole():
    outline, solids = trace([Box(0, 0, 4, 4), Box(4, 1, 6, 2)], [Box(1, 1, 2, 2, "pillar")])
    assert outline.area == pytest.approx(18.0)
    assert len(outline.points) == 8
    assert [s.area for s in solids] == [pytest.approx(-1.0)]
    assert solids[0].kinds == ("pillar",) * 4


def test_tracing_corners_that_touch():
    with pytest.raises(InputError, match="connected"):
        trace([Box(0, 0, 1, 1), Box(1, 1, 2, 2)])
    outline, _ = trace([Box(0, 0, 1, 1), Box(1, 1, 2, 2), Box(0, 1, 1, 2)])
    assert outline.area == pytest.approx(3.0)


def test_casting_and_clearance():
    plan = Plan("test", ring(SQUARE), (ring([(1, 1), (2, 1), (2, 2), (1, 2)], solid=True),))
    eye = np.array([3.0, 1.5])
    angles = np.array([0.0, math.pi, math.pi / 2, math.radians(45)])
    assert plan.cast(eye, angles) == pytest.approx([1.0, 1.0, 2.5, math.sqrt(2)])
    assert plan.clearance(np.array([[3.0, 1.5], [1.5, 1.5], [0.3, 2.0]])) == pytest.approx([1.0, -0.5, 0.3])
    assert plan.sees(eye, np.array([[2.0, 1.0], [1.0, 1.0], [4.0, 4.0]])).tolist() == [True, False, True]
    assert inside(plan.outline, np.array([[1.0, 3.0], [5.0, 1.0]])).tolist() == [True, False]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"outline": Ring(((0, 0), (2, 2), (2, 0), (0, 2)), ("wall",) * 4)}, "area|cross"),
        ({"outline": Ring(((0, 0), (5, 4), (5, 0), (0, 3)), ("wall",) * 4)}, "cross"),
        ({"outline": Ring(((0, 0), (2, 0)), ("wall",) * 2)}, "three corners"),
        ({"outline": Ring(tuple(SQUARE), ("wood",) * 4)}, "unknown surface 'wood'"),
        ({"solids": (ring([(8, 8), (9, 8), (9, 9)], solid=True),)}, "outside the walls"),
        ({"start": (0.1, 0.1, 0.0)}, "start"),
        ({"height": 0.0}, "height"),
    ],
)
def test_bad_plans(change, message):
    with pytest.raises(InputError, match=message):
        Plan(**({"name": "test", "outline": ring(SQUARE)} | change))


def test_unknown_arena():
    with pytest.raises(InputError, match="choose one of hallway, curve"):
        load_arena("halway")


GOOD = """
name = "lab"
rooms = [[0, 0, 8, 6], [8, 2, 14, 4]]
pillars = [{x = 4, y = 3, width = 0.4, round = true}]
start = [1, 1, 90]
"""


def test_arena_file(tmp_path):
    file = tmp_path / "lab.toml"
    file.write_text(GOOD)
    plan = load_arena(str(file))
    assert plan.outline.area == pytest.approx(60.0)
    assert plan.start == (1.0, 1.0, pytest.approx(math.pi / 2))
    file.write_text('name = "x"\nwalls = [[0,0,4,0],[4,0,4,4],[4,4,0,4],[0,4,0,0]]\nblank_walls = [2]')
    assert load_arena(str(file)).outline.kinds == ("wall", "wall", "blank", "wall")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('name = "x"\nwalls = [[0,0,4,0],[4,0.3,4,4],[4,4,0,0]]', r"gap of 0.30 m .* end of wall 0"),
        (GOOD + "hue = 3", "unknown key 'hue'; known: name, rooms"),
        (GOOD + "[[pillar]]\nx=1", "unknown key 'pillar'"),
        (GOOD.replace("width = 0.4", "width = -1"), r"pillars.0.width = -1: should be greater"),
        (GOOD.replace("width = 0.4", 'width = "40 cm"'), "pillars.0.width = '40 cm'"),
        (GOOD.replace("[8, 2, 14, 4]", "[8, 2, 14, 2.3]"), "at least 0.6 m wide"),
        ('name = "x"\nrooms = [[0, 0, 9, 0.65]]', "nowhere as wide as the car"),
        ('name = "x"\nrooms = [[0, 0, 1, 1], [3, 3, 4, 4]]', "connected"),
        ('name = "x"', "either rooms or walls"),
        (GOOD.replace("[1, 1, 90]", "[20, 1, 90]"), "start"),
        ("name = ", "not a TOML file"),
    ],
)
def test_bad_arena_files(tmp_path, text, message):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        load_arena(str(file))
    assert "\n" not in str(error.value)
    assert "bad.toml" in str(error.value)


def test_missing_arena_file():
    with pytest.raises(InputError, match="no such file"):
        load_arena("nowhere.toml")
