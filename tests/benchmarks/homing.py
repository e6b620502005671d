"""Home after a long way: out by exploring, back to the start.

    python -m tests.benchmarks.homing office 9001 9006    # one line of JSON for each drive

The odometry is wrong and the wheels slip. After 30 to 110 m, as the seed draws, the car is sent home.
"""

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
from ndtorch.navigation.localisation.localiser import LocaliserState
from ndtorch.navigation.localisation.ndt import to_sparse
from ndtorch_robot.camera_monitor import CameraMonitor
from ndtorch_robot.car import Car
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import DRAWN
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Step
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import Simulation

OUT_M, OUT_S, HOME_S, STANDS = (30.0, 110.0), 900.0, 300.0, 30
"""Metres out, seconds after which either leg ends, and steps for which an arrived car has stood."""


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
        limits = config.robot_config.simulated_limits
        check = CameraMonitor(simulation.rig, runner.rate, limits.frame_age_s, DRAWN, rendered=True)
        car = Car(runner, simulation, SafeDrive(simulation, simulation, limits, check))
        self.at = simulation.pose[:2]

        def watch(step: Step) -> None:
            here = simulation.pose[:2]
            self.metres, self.at = self.metres + math.dist(here, self.at), here
            self.stood = self.stood + 1 if step.state is not None and runner.mode() == ARRIVED else 0
            if self.stood >= STANDS or self.metres >= self.most:
                car.ended.set()

        car.observers += [*observers, watch]
        car.run(seconds)


def drive_home(arena: str, seed: int) -> dict[str, Any]:
    """Where the car ends, and the bytes that its localiser keeps when it is sent home."""
    wrong: dict[str, Any] = {"odometry": "noisy", "disturbance": "slip"}
    asked: dict[str, Any] = {"controller": "goal", "explore": True, "localise": True}
    config = DriveConfig(arena=arena, seed=seed, **wrong, **asked)
    runner = NavigatorRunner(config, config.robot_config.stereo_rig, config.robot_config.rate_hz)
    simulation = Simulation(
        load_arena(arena, seed),
        seed,
        odometry=config.odometry,
        fields=runner.fields,
        disturbances=config.disturbance_values,
        rate=runner.rate,
    )
    home = simulation.pose[:2]

    def located() -> LocaliserState:
        assert runner.state is not None
        assert runner.state.located is not None
        return runner.state.located

    out = Leg(runner, simulation, float(np.random.default_rng(seed).uniform(*OUT_M)))
    out.drive(config, OUT_S, [])
    state, turned = located(), simulation.pose[:2]
    cells = to_sparse(state.ndt_map)
    rest = [part for name, part in state._asdict().items() if name != "ndt_map"]
    runner.drive_to(*home)
    back = Leg(runner, simulation, math.inf)
    back.drive(config, HOME_S, [])
    assert runner.state is not None
    simulation.close()
    return {
        "arena": arena,
        "seed": seed,
        "out_m": round(out.metres, 1),
        "away_m": round(math.dist(turned, home), 1),
        "turning_error_m": round(math.dist(state.pose[:2], turned), 3),
        "bytes": len(zlib.compress(pickle.dumps((cells, rest)), 9)),
        "arrived": back.stood >= STANDS,
        "error_m": round(math.dist(back.at, home), 3),
        "hits": len(simulation.collisions),
        "reckoning_error_m": round(math.dist((runner.state.pose.x, runner.state.pose.y), back.at), 2),
    }


if __name__ == "__main__":
    torch.set_num_threads(1)
    for seed in range(int(sys.argv[2]), int(sys.argv[3])):
        print(json.dumps(drive_home(sys.argv[1], seed)), flush=True)
