"""Home after a long way: out by exploring, back to the start, with maps of several sizes.

    python -m tests.benchmarks.homing office 9001 9006    # one line of JSON for each drive home

The odometry is wrong and the wheels slip. After 30 to 110 m, as the seed draws, the car is sent home, from the same
place and in the same state for each map. Beside the full localiser are maps of `localisation.compact_map`, which do not
change on the drive home.
"""

from __future__ import annotations

import copy
import json
import math
import pickle
import sys
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from ndtorch.navigation import ARRIVED
from ndtorch.navigation.localisation import LocaliserState
from ndtorch.navigation.localisation.compact_map import compact_map, expand_map
from ndtorch_robot.camera_monitor.frame_check import FrameCheck
from ndtorch_robot.car import Car
from ndtorch_robot.config import DriveConfig, load_config
from ndtorch_robot.drive import DRAWN
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Step
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.disturbances import read_disturbances
from ndtorch_robot.sim.simulation import Simulation

OUT_M, OUT_S, HOME_S, STANDS = (30.0, 110.0), 900.0, 300.0, 30
"""Metres out, seconds after which either leg ends, and steps for which an arrived car has stood."""

SHARES: dict[str, float | None] = {"full": None, "compact": 1.0, "quarter": 0.25, "none": 0.0}
"""Share of the map's cells that is kept, those nearest to home; None is the full localiser, 0 the corrected pose of the
turning point and dead reckoning from there."""


@dataclass
class Leg:
    """A drive out or home.

    Attributes:
        metres: driven.
        at: true place of the car.
        stood: steps since it arrived.
    """

    runner: NavigatorRunner
    simulation: Simulation
    most: float
    metres: float = 0.0
    at: tuple[float, float] = (0.0, 0.0)
    stood: int = 0

    def drive(self, config: DriveConfig, seconds: float, observers: list[Callable[[Step], None]]) -> None:
        runner, simulation = self.runner, self.simulation
        check = FrameCheck(
            simulation.rig, config.rate, config.limits.age, joint_freeze=False, limits=DRAWN, floor=runner.fields
        )
        car = Car(runner, simulation, SafeDrive(simulation, simulation, config.limits, check))
        self.at = simulation.pose[:2]

        def watch(step: Step) -> None:
            here = simulation.pose[:2]
            self.metres, self.at = self.metres + math.dist(here, self.at), here
            self.stood = self.stood + 1 if step.state is not None and runner.mode() == ARRIVED else 0
            if self.stood >= STANDS or self.metres >= self.most:
                car.ended.set()

        car.observers += [*observers, watch]
        car.run(seconds)


def compacted(located: LocaliserState, cell_m: float, home: tuple[float, float], share: float) -> tuple[bytes, Any]:
    """The packed map, and the localiser's state with it instead of submaps and log."""
    whole = compact_map(located.ndt_map, cell_m, home)
    cells = len(zlib.decompress(whole)) // 6
    packed = compact_map(located.ndt_map, cell_m, home, round(share * cells))
    ndt_map = expand_map(packed, len(located.ndt_map), cell_m)
    return packed, located._replace(ndt_map=ndt_map, graph=None, log=None)


def drives_home(arena: str, seed: int, shares: dict[str, float | None]) -> list[dict[str, Any]]:
    """Where the car ends after each drive home."""
    wrong: dict[str, object] = {"odometry": "noisy", "disturbance": "slip"}
    asked: dict[str, object] = {"controller": "goal", "explore": True, "localise": True}
    config = load_config(None, {"arena": arena, "seed": seed, **wrong, **asked})
    runner = NavigatorRunner(config.options(), config.rig, config.rate)
    simulation = Simulation(
        load_arena(arena, seed),
        seed,
        odometry=config.odometry,
        fields=runner.fields,
        disturbances=read_disturbances(config.disturbance),
        rate=config.rate,
    )
    home = simulation.pose[:2]
    out = Leg(runner, simulation, float(np.random.default_rng(seed).uniform(*OUT_M)))
    out.drive(config, OUT_S, [])
    moving = ("effects", "delay", "car", "steps", "collisions", "placed")
    begin = {name: copy.deepcopy(getattr(simulation, name)) for name in moving}
    state, when, rows = runner.state, runner.time, []
    assert state is not None
    assert state.located is not None
    assert runner.navigator.localiser is not None
    cell_m = runner.navigator.localiser.params.cell_m
    for name, share in shares.items():
        for part, value in begin.items():
            setattr(simulation, part, copy.deepcopy(value))
        runner.state, runner.time = state, when
        observers: list[Callable[[Step], None]] = []
        kept: object = state.located
        if share is not None:
            packed, located = compacted(state.located, cell_m, home, share)
            runner.state = state._replace(located=located)
            kept = (packed, located._replace(ndt_map=None))

            def unchanged(step: Step, ndt_map: Any = located.ndt_map) -> None:
                assert runner.state is not None
                assert runner.state.located is not None
                runner.state = runner.state._replace(located=runner.state.located._replace(ndt_map=ndt_map))

            observers.append(unchanged)
        runner.drive_to(*home)
        back = Leg(runner, simulation, math.inf)
        back.drive(config, HOME_S, observers)
        row = {
            "map": name,
            "out_m": round(out.metres, 1),
            "bytes": len(zlib.compress(pickle.dumps(kept), 9)),
            "map_bytes": None if share is None else len(packed),
            "arrived": back.stood >= STANDS,
            "error_m": round(math.dist(back.at, home), 3),
            "hits": len(simulation.collisions),
            "reckoning_error_m": round(math.dist((runner.state.pose.x, runner.state.pose.y), back.at), 2),
        }
        rows.append({"arena": arena, "seed": seed, **row})
        print(json.dumps(rows[-1]), flush=True)
    simulation.close()
    return rows


if __name__ == "__main__":
    torch.set_num_threads(1)
    for seed in range(int(sys.argv[2]), int(sys.argv[3])):
        drives_home(sys.argv[1], seed, SHARES)
