"""Plans: arenas by name and seed, rooms to walls, ray casting, free places, files."""

import math
from pathlib import Path

import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch_robot.sim.arenas import arenas, load_arena
from ndtorch_robot.sim.arenas.buildings import DOOR_SPACING
from ndtorch_robot.sim.floors import Floor, Lamp, covered
from ndtorch_robot.sim.plan import Plan, Ring, cylinder, inside, ring
from ndtorch_robot.sim.shapes import Box, trace
from ndtorch_robot.sim.spawn_points import SpawnPoints

OTHERS = Path(__file__).resolve().parents[3] / "robot" / "arenas"
SQUARE = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)]


@pytest.mark.parametrize(
    ("name", "seed"), [*((n, 7) for n in arenas(test=False)), *((n, 5) for n in arenas(test=True))]
)
def test_arenas(name, seed):
    plan = load_arena(name, seed)
    assert plan == load_arena(name, seed)
    assert plan.name == name
    assert plan.outline.area > 0
    assert all(solid.area < 0 for solid in plan.solids)
    places = SpawnPoints(plan)
    assert len(places.points) > 10
    assert (plan.clearance(places.points) > 0.4).all()
    x, y, heading = places.random(np.random.default_rng(seed))
    assert places.lengths(x, y, np.array([heading]))[0] > 1.0
    (ax, ay), (bx, by) = places.walk(np.random.default_rng(seed), (x, y))
    assert 0.3 < math.hypot(bx - ax, by - ay) < 4.001


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
        ('name = "x"\nrooms = [[0, 0, 9, 0.65]]', "nowhere as wide as the robot needs"),
        ('name = "x"\nrooms = [[0, 0, 1, 1], [3, 3, 4, 4]]', "connected"),
        ('name = "x"', "either rooms or walls"),
        (GOOD.replace("[1, 1, 90]", "[20, 1, 90]"), "start"),
        ("name = ", "not a TOML file"),
        ('name = "x"\nrooms = [[0, 0, 4, 4]]\nblank_walls = [0]', "blank_walls are numbers of walls"),
        (
            'name = "x"\n' + "walls = [[0, 0, 4, 0], [4, 0, 4, 4], [4, 4, 0, 0]]\ndoors = [[1, 0, 2, 1]]",
            "doors join rooms",
        ),
        ('name = "x"\nrooms = [[0, 0, 4, 4]]\nramps = [[0, 0, 1, 1]]', "ramps cannot be built"),
        (
            'name = "x"\n' + "rooms = [[0, 0, 4, 4], [4.1, 0, 8, 4]]\ndoors = [[4, 1, 4.1, 1.3]]",
            "narrower than the car",
        ),
    ],
)
def test_bad_arena_files(tmp_path, text, message):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        load_arena(str(file))
    assert "\n" not in str(error.value)
    assert "bad.toml" in str(error.value)


@pytest.mark.parametrize("file", sorted(OTHERS.glob("*.toml")), ids=lambda file: file.stem)
def test_arena_files_that_come_along(file):
    plan = load_arena(str(file))
    assert plan.name == file.stem
    assert len(SpawnPoints(plan).points) > 20


def test_what_hangs_high_or_lies_flat_is_no_obstacle():
    square = [(1, 1), (2, 1), (2, 2), (1, 2)]
    plans = {
        name: Plan("test", ring(SQUARE), (ring(square, "furniture", height, solid=True, bottom=bottom),))
        for name, bottom, height in (("sofa", 0.12, 0.8), ("table", 0.7, 0.75), ("sill", 0.0, 0.02), ("step", 0.0, 0.1))
    }
    middle = np.array([[1.5, 1.5]])
    assert {name: bool(plan.is_free(middle)[0]) for name, plan in plans.items()} == {
        "sofa": False,
        "table": True,
        "sill": True,
        "step": False,
    }
    assert plans["table"].cast(np.array([0.5, 1.5]), np.zeros(1)) == pytest.approx([3.5])
    assert plans["sofa"].cast(np.array([0.5, 1.5]), np.zeros(1)) == pytest.approx([0.5])
    with pytest.raises(InputError, match="bottom"):
        Plan("test", ring(SQUARE), (ring(square, "furniture", 0.5, solid=True, bottom=0.6),))


def test_floors():
    x = y = np.asarray((np.arange(256) + 0.5) / 128, np.float32)
    rng = np.random.default_rng(0)
    assert Floor().light(x, y, 1 / 128, rng) is None
    tiles = Floor("tiles").light(x, y, 1 / 128, rng)
    joint = np.abs(x - 0.6).argmin()
    assert tiles[100, joint] < 0.6 < 0.8 < tiles[100, joint + 8]
    # A joint of 6 mm is thinner than a texel: what it takes away is right all the same.
    assert covered(x, 0.3, 0.006, 1 / 128)[:230].sum() / 128 == pytest.approx(0.006 * 5.5, abs=0.003)
    checks = Floor("checker").light(x, y, 1 / 128, rng)
    assert checks[5, 5] != checks[5, 5 + 32] == checks[5 + 32, 5]
    pool = Floor(lamps=(Lamp(1.0, 1.0, 0.2, 0.5),)).light(x, y, 1 / 128, rng)
    assert pool[128, 128] == pytest.approx(1.5, abs=0.01)
    assert pool[0, 0] == pytest.approx(1.0, abs=0.01)
    with pytest.raises(InputError, match="floor must be one of"):
        Floor("parquet")


def test_file_with_furniture(tmp_path):
    file = tmp_path / "lab.toml"
    file.write_text(
        """name = "lab"
rooms = [[0, 0, 4, 4], [4.1, 0, 8.6, 4], [8, 4, 8.6, 5]]
doors = [[4, 1, 4.1, 1.8]]
boxes = [{at = [1, 2, 2, 3], bottom = 0.12, height = 0.75}, {at = [3, 0, 3.2, 4], height = 0.02}]
tables = [{at = [5, 2, 6, 2.8]}]
pillars = [
    {x = 7, y = 2, width = 0.05, round = true, height = 1},
    {x = 7.25, y = 2, width = 0.05, round = true, height = 1},
]
floor = "tiles"
lamps = [{x = 2, y = 2, radius = 0.5, gain = 0.8}]
"""
    )
    plan = load_arena(str(file))
    assert plan.floor == Floor("tiles", lamps=(Lamp(2, 2, 0.5, 0.8),))
    places = np.array([[4.05, 1.4], [1.5, 2.5], [3.1, 3.0], [5.5, 2.4], [8.3, 4.5]])
    assert plan.is_free(places).tolist() == [True, False, True, True, True]
    assert sum(shape.radius > 0 for shape in plan.solids) == 6
    assert len(plan.remarks) == 1
    assert "a gap of 0.20 m near (7." in plan.remarks[0]


def test_the_heading_of_a_start_is_free_for_the_whole_body():
    pole = cylinder(2.5, 0.12, 0.015, 0.44, 6)
    plan = Plan("pole", ring([(0.0, -2.0), (8.0, -2.0), (8.0, 2.0), (0.0, 2.0)]), (pole,))
    ahead, aside, gap = SpawnPoints(plan).lengths(1.5, 0.0, np.array([0.0, math.pi / 2, math.pi]))
    assert ahead == pytest.approx(1.0, abs=0.02)  # between the middle of the body and its side
    assert aside == pytest.approx(2.0)
    assert gap == pytest.approx(1.5)
