"""How often a standing car takes for near what is not: `python -m tests.benchmarks.near ARENA FIRST LAST [POSES]`.

At poses before which the car could drive for 1.4 m, the near check is asked and its answer compared with the physics:
whether the body, also moved aside to either end of the path that is looked at, touches anything on the next 1.1 m.
"""

import math
import sys

import numpy as np
import torch

from ndtorch.navigation.near_check import NearCheck
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import RIG, Simulation

ASIDE, AHEAD = 0.12, 1.1
"""The body is 0.36 m wide and the path 0.6 m; the farthest thing that is near lies 1.1 m ahead of the car's middle."""


def something_is_near(simulation: Simulation, x: float, y: float, heading: float) -> bool:
    for way in np.arange(0.0, AHEAD - 0.25, 0.02):
        for aside in (-ASIDE, 0.0, ASIDE):
            simulation.car.place(
                x + way * math.cos(heading) - aside * math.sin(heading),
                y + way * math.sin(heading) + aside * math.cos(heading),
                heading,
            )
            if simulation.touches():
                return True
    return False


def poses(simulation: Simulation, seed: int, count: int) -> list[tuple[float, float, float]]:
    rng, places, found = np.random.default_rng(seed), simulation.spawn_points, []
    while len(found) < count:
        x, y = places.points[int(rng.integers(len(places.points)))]
        heading = float(rng.uniform(-math.pi, math.pi))
        if places.lengths(x, y, np.array([heading]), 0.3)[0] > 1.4:
            found.append((float(x), float(y), heading))
    return found


def asked(arena: str, seed: int, count: int) -> tuple[int, int, int]:
    """Poses with nothing near, those where it sees a thing there all the same, and those where it sees no floor."""
    fields = NavigatorOptions().fields(RIG)
    simulation, check, total = Simulation(load_arena(arena, seed), seed, fields=fields), NearCheck(RIG, fields), [0] * 3
    try:
        for pose in poses(simulation, seed, count):
            if something_is_near(simulation, *pose):
                continue
            simulation.place(*pose)
            seen = simulation.capture()
            things, floor = check((seen.left.field[0], seen.right.field[0]), (seen.left.row[0], seen.right.row[0]))
            for k, counts in enumerate((True, len(things.x) > 0, not floor)):
                total[k] += counts
            if len(things.x):
                print(
                    f"  {[round(v, 2) for v in pose]}: {len(things.x)} places from {things.x[0]:.2f} m on", flush=True
                )
    finally:
        simulation.close()
    return total[0], total[1], total[2]


def main(arena: str, first: int, last: int, count: int = 60) -> None:
    with torch.inference_mode():
        for seed in range(first, last + 1):
            clear, things, blind = asked(arena, seed, count)
            print(f"{arena} {seed}: of {clear} poses with nothing near: things {things}, no floor {blind}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
