"""Plans: arenas by name and seed, rooms to walls, ray casting, contact, free places, files."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch_robot.sim._kernels import rectangle_touches
from ndtorch_robot.sim.arenas import ARENAS, DOOR_SPACING, Box, load_arena, trace
from ndtorch_robot.sim.plan import Plan, SpawnPoints, cylinder, inside, ring

FILES = Path(__file__).resolve().parents[3] / "robot" / "arenas"
SQUARE = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)]


@pytest.mark.parametrize(
    "name", [*ARENAS, *sorted(str(file) for file in FILES.glob("*.toml") if file.stem not in ARENAS)]
)
def test_arenas(name):
    plan = load_arena(name, 7)
    assert plan == load_arena(name, 7)
    assert plan.name == Path(name).stem
    assert plan.outline.area > 0
    assert all(solid.area < 0 for solid in plan.solids)
    places = SpawnPoints(plan)
    assert len(places.points) > 10
    assert (plan.clearance(places.points) > 0.4).all()
    x, y, heading = places.random(np.random.default_rng(7))
    assert places.lengths(x, y, np.array([heading]))[0] > 1.0


def test_hallway_doors():
    """[A §2.3] Doors 1.308 m apart."""
    plan = load_arena("hallway", 3)
    corners = {(round(x, 6), round(y, 6)) for r in plan.rings for x, y in r.points}
    assert len(plan.doors) == 12
    for row in plan.doors:
        assert all((round(x, 6), round(y, 6)) in corners for x, y in row)
        assert np.allclose(np.diff([x for x, _ in row]), DOOR_SPACING)
    assert (plan.outline.kinds.count("door"), plan.outline.kinds.count("jamb")) == (18, 36)


def test_tracing_rooms():
    outline, solids = trace([Box(0, 0, 4, 4), Box(4, 1, 6, 2)], [Box(1, 1, 2, 2, "pillar")])
    assert outline.area == pytest.approx(18.0)
    assert len(outline.points) == 8
    assert [s.area for s in solids] == [pytest.approx(-1.0)]
    assert solids[0].kinds == ("pillar",) * 4
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
    assert inside(plan.outline, np.array([[1.0, 3.0], [5.0, 1.0]])).tolist() == [True, False]


def test_contact_is_where_points_of_the_surface_are_in_the_rectangle():
    rng, half, hits = np.random.default_rng(0), np.array([0.25, 0.18]), 0
    for _ in range(300):
        x, y, heading, ax, ay, bx, by, radius = rng.uniform(-1, 1, 8)
        pose, turn = (x, y, 3 * heading), -3 * heading
        line = np.linspace((ax, ay), (bx, by), 2000)
        angle = np.linspace(0, 2 * math.pi, 2000)
        rim = (ax, ay) + 0.3 * abs(radius) * np.stack((np.cos(angle), np.sin(angle)), 1)
        for points, segments, circles in (
            (line, [[(ax, ay), (bx, by)]], []),
            (np.concatenate((rim, [(ax, ay)])), [], [(ax, ay, 0.3 * abs(radius))]),
        ):
            dx, dy = (points - (x, y)).T
            own = np.stack((math.cos(turn) * dx - math.sin(turn) * dy, math.sin(turn) * dx + math.cos(turn) * dy), 1)
            depth = (half - np.abs(own)).min(1).max()
            if abs(depth) > 0.01:
                given = np.array(segments).reshape(-1, 2, 2), np.array(circles).reshape(-1, 3)
                assert rectangle_touches(*pose, half, *given) == (depth > 0), (pose, segments, circles)
                hits += depth > 0
    assert hits > 50


def test_what_hangs_high_or_lies_flat_is_no_obstacle():
    square = [(1, 1), (2, 1), (2, 2), (1, 2)]
    shapes = {"sofa": (0.12, 0.8), "table": (0.7, 0.75), "sill": (0.0, 0.02), "step": (0.0, 0.1)}
    free = {}
    for name, (bottom, height) in shapes.items():
        plan = Plan("test", ring(SQUARE), (ring(square, "furniture", height, solid=True, bottom=bottom),))
        free[name] = bool(plan.clearance(np.array([[1.5, 1.5]]))[0] > 0)
        assert plan.cast(np.array([0.5, 1.5]), np.zeros(1)) == pytest.approx([3.5 if free[name] else 0.5])
    assert free == {"sofa": False, "table": True, "sill": True, "step": False}


FILE = """
name = "lab"
rooms = [[0, 0, 4, 4], [4.1, 0, 8.6, 4], [8, 4, 8.6, 5]]
doors = [[4, 1, 4.1, 1.8]]
boxes = [{at = [1, 2, 2, 3], bottom = 0.12, height = 0.75}, {at = [3, 0, 3.2, 4], height = 0.02}]
tables = [{at = [5, 2, 6, 2.8]}]
pillars = [{x = 7, y = 2, width = 0.05, round = true, height = 1}]
floor = "tiles"
start = [1, 1, 90]
"""


def test_arena_file(tmp_path):
    file = tmp_path / "lab.toml"
    file.write_text(FILE)
    plan = load_arena(str(file))
    assert plan.start == (1.0, 1.0, pytest.approx(math.pi / 2))
    assert plan.floor == "tiles"
    assert plan.outline.area == pytest.approx(16 + 18 + 0.6 + 0.08)
    places = np.array([[4.05, 1.4], [1.5, 2.5], [3.1, 3.0], [5.5, 2.4], [8.3, 4.5]])
    assert (plan.clearance(places) > 0).tolist() == [True, False, True, True, True]
    assert sum(shape.radius > 0 for shape in plan.solids) == 5


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (FILE + "hue = 3", "unknown key 'hue'; known: name, description, rooms"),
        (FILE.replace("width = 0.05", "width = -1"), r"pillars.0.width = -1: should be greater"),
        (FILE.replace("[8, 4, 8.6, 5]", "[8, 4, 8.3, 5]"), "at least 0.6 m wide"),
        ('name = "x"\nrooms = [[0, 0, 9, 0.65]]', "nowhere as wide as the robot needs"),
        ('name = "x"\nrooms = [[0, 0, 1, 1], [3, 3, 4, 4]]', "connected"),
        ('name = "x"\nrooms = [[0, 0, 900, 4]]', "too large"),
        (FILE.replace("x = 7", "x = 70"), "outside the walls"),
        (FILE.replace("[1, 1, 90]", "[0.1, 1, 90]"), "start"),
        (FILE.replace("0.12", "0.75"), "bottom below its height"),
    ],
)
def test_bad_arena_files(tmp_path, text, message):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        load_arena(str(file))
    assert "\n" not in str(error.value)
    assert "bad.toml" in str(error.value)


def test_the_heading_of_a_start_is_free_for_the_whole_body():
    pole = cylinder(2.5, 0.12, 0.015, 0.44, 6)
    plan = Plan("pole", ring([(0.0, -2.0), (8.0, -2.0), (8.0, 2.0), (0.0, 2.0)]), (pole,))
    ahead, aside, behind = SpawnPoints(plan).lengths(1.5, 0.0, np.array([0.0, math.pi / 2, math.pi]))
    assert ahead == pytest.approx(1.0, abs=0.02)  # between the middle of the body and its side
    assert (aside, behind) == pytest.approx((2.0, 1.5))


def test_a_map_of_ros(tmp_path):
    """A room of 5 m by 4 m, turned by 30 degrees, with a round post of 15 cm radius, at its place in the world.

    Beside it is a closet, and beyond a wall of one pixel unknown ground.
    """
    image = np.full((160, 200), 205, np.uint8)
    corners = cv2.boxPoints(((100, 80), (100, 80), 30))
    cv2.fillPoly(image, [np.rint(corners).astype(int)], 254)
    cv2.polylines(image, [np.rint(corners).astype(int)], True, 0)
    cv2.circle(image, (100, 80), 3, 0, -1)
    image[2:8, 2:8] = 254
    cv2.imwrite(str(tmp_path / "map.png"), image)
    text = "image: map.png\nmode: trinary\nresolution: 0.05\norigin: [1.0, -2.0, {}]\nnegate: 0\n"
    file = tmp_path / "map.yaml"
    file.write_text(text.format(0.0) + "occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    plan = load_arena(str(file))
    assert plan.name == "map"
    assert plan.outline.area == pytest.approx(20.0, rel=0.03)
    assert len(plan.outline.points) < 100
    (post,) = plan.solids
    assert -post.area == pytest.approx(math.pi * 0.15**2, rel=0.25)
    middle = post.array.mean(0)
    assert middle == pytest.approx((1.0 + 100.5 * 0.05, -2.0 + 79.5 * 0.05), abs=0.03)
    file.write_text(text.format(math.pi / 2))
    x, y = middle - (1.0, -2.0)
    assert load_arena(str(file)).solids[0].array.mean(0) == pytest.approx((1.0 - y, -2.0 + x), abs=0.01)
    file.write_text(text.format(0.0).replace("map.png", "none.png"))
    with pytest.raises(InputError, match=r"map.yaml: its image none.png cannot be read"):
        load_arena(str(file))
