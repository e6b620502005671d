"""`ndtorch guard`."""

from __future__ import annotations

import contextlib
import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from ndtorch.errors import InputError
from ndtorch_robot.commands.evaluate import SEEDS, arenas_of, name_of

SECONDS = 60.0
"""Simulated time of a drive that judges the guard."""


@dataclass(frozen=True)
class Guard:
    """Pass on a command from outside as far as two cameras see room for it: a collision monitor for any planner.

    The command comes from one of the `[bridges]` of the car: ros2, mavlink or gamepad. With --arenas the guard is
    judged instead: in these arenas it is given commands that ignore obstacles.
    """

    config: Annotated[Path | None, tyro.conf.Positional] = None
    """This TOML file describes the car and its bridges, as for `run`."""
    seconds: float | None = None
    """The drive ends after this time, in s (default: on SIGTERM; 60 s for each arena and seed)."""
    arenas: tuple[str, ...] = ()
    """Guarded drives take place in these simulated arenas: names, .toml files, or buildings, tests, all."""
    seeds: tuple[int, ...] = SEEDS
    """Buildings, starts and the commands follow from these numbers."""
    jobs: int = 0
    """This number of drives runs at a time; 0 is one a core."""
    unguarded: bool = False
    """In the arenas the same commands are also driven without the guard, for a row of the table."""
    out: Path = Path("out/guard")
    """Results of the arenas are kept in this folder, and the table is written there."""

    def run(self) -> int:
        if (self.config is None) == (not self.arenas):
            raise InputError("guard needs the file of a car, or --arenas to be judged in")
        if self.seconds is not None and not 0 < self.seconds < 1e7:
            raise InputError(f"--seconds must be positive, got {self.seconds}")
        return self.judge() if self.arenas else self.drive()

    def drive(self) -> int:
        """Guard a car until it is told to end."""
        from ndtorch_robot.bridges import Opening, Wish, open_bridges
        from ndtorch_robot.emergency import emergency_stops
        from ndtorch_robot.guard import Guard as Steer
        from ndtorch_robot.run import open_car, real_time_priority, timed_report
        from ndtorch_robot.run_config import read_run_config

        assert self.config is not None
        config = read_run_config(self.config)
        if not config.bridges:
            raise InputError(
                f"{self.config}: nobody gives a command: add [bridges.ros2], [bridges.mavlink] or [bridges.gamepad]"
            )
        report, wish = timed_report(), Wish()
        real_time_priority(report)
        with contextlib.ExitStack() as stack:
            car = stack.enter_context(open_car(config, report, go=True))
            car.steer = Steer(car.runner, wish)
            stack.enter_context(emergency_stops(car.safe, car.ended))
            opening = Opening(config.robot, report, car.runner, config.link, wish)
            car.observers += stack.enter_context(open_bridges(config.bridges, opening))
            report("guards; SIGUSR1: go, SIGTERM: stop and end")
            car.run(self.seconds)
            print(json.dumps(car.summary()))
        return 0

    def judge(self) -> int:
        """Drive in all arenas, and write the table."""
        from ndtorch.utils.files import write_text
        from ndtorch_robot.config import load_config
        from ndtorch_robot.evaluation.drives import DriveCache, finish, processes_of
        from ndtorch_robot.evaluation.guard import guard_table, guarded_drive

        seconds = self.seconds or SECONDS
        given = [(arena, seed) for arena in arenas_of(self.arenas) for seed in self.seeds]
        drives = [load_config(None, {"arena": arena, "seed": seed, "seconds": seconds}) for arena, seed in given]
        troubles, found = [], []
        for guarded in (True, False)[: 1 + self.unguarded]:
            cache = DriveCache(self.out / ("guarded" if guarded else "unguarded"))
            work = partial(guarded_drive, guarded=guarded)
            troubles += finish(work, drives, cache, processes_of(self.jobs), name_of, lambda config: config.seconds)
            found.append([summary for config in drives if (summary := cache.get(config)) is not None])
        table = guard_table(*found)
        write_text(self.out / "table.md", table)
        print(table + "".join(f"failed: {trouble}\n" for trouble in troubles), end="")
        return 1 if troubles else 0
