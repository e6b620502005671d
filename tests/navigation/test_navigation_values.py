"""What ranging, maps, controllers and localisation give is what is in `navigation_values.txt`."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch

from ndtorch.navigation import Command, Grid, NavigatorOptions, Pose, StereoRig, controller_names
from ndtorch.navigation.controllers.goal.frontiers import to_unvisited, where_to
from ndtorch.navigation.controllers.goal.planning import clearance, plan, to_place
from ndtorch.navigation.localisation import Localiser, LocaliserParams
from ndtorch.navigation.localisation.params import RetraceParams
from ndtorch.navigation.odometry import arc
from tests.navigation.controllers.goal.test_planning import CELL, PARAMS, SIDE, world
from tests.navigation.localisation.test_finding import Blindfold, building, known_walls
from tests.navigation.localisation.test_localiser import CORNERS
from tests.navigation.localisation.test_parts import Sighted, corridor, path, rounds
from tests.navigation.planar_world import PlanarWorld
from tests.properties import samples
from tests.test_properties import PARTS
from tests.values import compare, main, of_parts, table_of

pytest.importorskip("numba")

DT = 0.2


def pose_of(values: Any) -> Pose:
    return Pose(*(torch.tensor(float(value)) for value in values))


def steered(steps: int = 24, **options: Any) -> Any:
    """A navigator before a picture that goes by, told of another way than it commands."""
    rig, state = StereoRig(forward=0.15), None
    navigator = NavigatorOptions(**options).navigator(rig, 30.0, Grid(cell=0.25), near_check=True)
    chance = torch.Generator().manual_seed(5)
    picture = samples((1, 1, 1, 480, 1200), "noise", chance).float()[0, 0]
    picture = torch.nn.functional.avg_pool2d(picture[None], 9, 1, 4)[0]
    picture = (picture - picture.min()) / (picture.max() - picture.min())
    driven, commands = Command(torch.full((1,), 0.4), torch.full((1,), 0.3)), []
    for n in range(steps):
        left, right = (picture[..., at : at + 640] for at in (60 + 6 * n, 96 + 6 * n))
        command, state = navigator(left[None], right[None], state, driven=driven)
        commands.append(command)
    return commands, state


def localised() -> Any:
    """Once round in a room, with wheels that count too much."""
    world = PlanarWorld(np.stack((CORNERS, np.roll(CORNERS, -1, 0)), 1), panels=(0.08, 0.5), seed=3)
    true, told = [(0.0, -1.2, 0.0)], [(0.0, -1.2, 0.0)]
    for _ in range(36):
        true.append(arc(*true[-1], 0.5, 0.9, DT))
        told.append(arc(*told[-1], 0.52, 0.89, DT))
    left, right, _ = world.drive(true)
    localiser, state = Localiser(StereoRig(), DT, LocaliserParams(every=DT)), None
    for *rows, pose in zip(left, right, told, strict=True):
        state = localiser(torch.from_numpy(np.stack(rows)).float(), pose_of(pose), state)
    return state


def found_again() -> Any:
    """The search for the place in a known map, and some of what it remembers on the way."""
    points = building(4)
    localiser = Blindfold(StereoRig(), DT, LocaliserParams(every=DT), known_walls(points))
    localiser.points = points
    state, kept = None, []
    for n in range(160):
        localiser.pose = (4.5 + 1.6 * math.cos(0.06 * n), 3 + 1.6 * math.sin(0.06 * n), 0.06 * n + math.pi / 2)
        x, y, heading = localiser.pose
        state = localiser(torch.zeros(2, 8), pose_of((y - 3, 6.1 - x, heading - math.pi / 2)), state)
        if n % 24 == 0:
            kept.append(state._replace(walls=None))
    return kept, state


def corrected() -> Any:
    """A round of a corridor with a wrong odometer: parts are fitted and moved, and the way is gone through again."""
    driven = rounds(1)[:170]
    true, told = path(driven), path(driven, 0.05, 0.03, math.radians(0.1) * DT)
    localiser = Sighted(StereoRig(), DT, LocaliserParams(every=DT, retrace=RetraceParams(after=(10.0,))))
    lines = [np.linspace(a, b, int(20 * math.dist(a, b)) + 2) for a, b in corridor()]
    localiser.points, localiser.rng = np.concatenate(lines), np.random.default_rng(0)
    state, kept = None, []
    for n, (here, there) in enumerate(zip(true, told, strict=True)):
        localiser.pose = tuple(here)
        state = localiser(torch.zeros(2, 8), pose_of(there), state)
        if n == 60:
            kept.append(state)
    return kept, state


def planned() -> Any:
    """Ways through maps of boxes and of what was not seen, to a place and to what is left."""
    made = []
    for seed in range(4):
        chance = np.random.default_rng(seed)
        walls = [(x, x + 0.4, y, y + 0.9) for x, y in chance.uniform(-3.6, 3.0, (7, 2))]
        around, visited = world(*walls), chance.random((SIDE, SIDE)) < 0.0
        visited[:, : 30 + 20 * seed] = True
        around.free[:, -12 * seed - 4 :] = False
        clear, pose = clearance(around.blocked, CELL), (-2.0, 0.3 * seed, 0.5 * seed)
        seeds = to_unvisited(around, visited, clear, PARAMS), to_place(around, (3.1, -1.0 + 2 * seed), PARAMS)
        for to in seeds:
            found = plan(around, clear, to, pose, 0.2 * seed - 0.3, 1.0, PARAMS, through=seed % 2 == 0)
            made.append((to, found, where_to(np.asarray(found.to_go), around, PARAMS.coarse, pose[:2])))
    return made


SCENES = (
    of_parts(PARTS, "ndtorch.navigation")
    | {f"controller {name}": partial(steered, controller=name) for name in controller_names() if name != "goal"}
    | {
        "goal": partial(steered, 60, controller="goal", to="4,1", back=True, localise=True, ranging="search"),
        "explore": partial(steered, 60, controller="goal", explore=True, ranging="search", map="log-odds"),
        "published": partial(
            steered, controller="published", features=5, places="motion", angle="linear", prediction=True
        ),
        "localised": localised,
        "found again": found_again,
        "corrected": corrected,
        "planned": planned,
    }
)


@pytest.mark.parametrize("scene", SCENES)
def test_the_numbers_are_those_that_were(scene: str) -> None:
    compare(table_of(__file__), scene, SCENES[scene])


if __name__ == "__main__":
    main(__file__, SCENES)
