"""`ndtorch run`."""

from __future__ import annotations

import contextlib
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from ndtorch.cli.command_run import INCOMPLETE
from ndtorch.errors import InputError

if TYPE_CHECKING:
    from ndtorch.run.folder import RunFolder
    from ndtorch_robot.car import Car
    from ndtorch_robot.run_config import RunConfig


@dataclass(frozen=True)
class Run:
    """Drive a car: cameras, navigator, safety layer and board, in real time.

    The car stands until the key g is pressed (or SIGUSR1 comes); any other key is an emergency stop. SIGINT and
    SIGTERM stop the car and end the program.
    """

    config: Annotated[Path, tyro.conf.Positional]
    """This TOML file describes the car, or one that is included: maxstone8, or sim for one without hardware."""
    seconds: float | None = None
    """The drive ends after this time, in s (default: on SIGTERM)."""
    go: bool = False
    """The car drives off without waiting for the key."""
    disturbance: str = ""
    """In a simulated world, these disturbances act on cameras and car: names or KEY=NUMBER as of `ndtorch drive`."""
    record: Path | None = None
    """The drive is recorded into this new file, NAME.mcap, for `ndtorch replay`, Foxglove and ROS 2."""
    save_map: Path | None = None
    """The map is written into this folder at the end, if navigation.map_half_size_m is above 0."""
    rrd: Path | None = None
    """The drive is also written into this file for the rerun viewer."""
    view: bool = False
    """The rerun viewer shows the drive as it goes; it listens at 127.0.0.1 only."""
    view_at: str | None = None
    """The drive is served at this ADDRESS or ADDRESS:PORT, for `rerun rerun+http://ADDRESS:9876/proxy` elsewhere."""
    json: bool = False
    """The summary is printed as one JSON object, and nothing else on stdout."""

    def run(self) -> int:
        import torch

        from ndtorch_robot.bridges import Opening, open_bridges
        from ndtorch_robot.emergency import HELP, emergency_stops
        from ndtorch_robot.map_saving import WalkedPath, save_runner_map
        from ndtorch_robot.recording import Recorder
        from ndtorch_robot.run import open_car, real_time_priority, timed_report
        from ndtorch_robot.run_config import read_run_config

        if self.seconds is not None and not 0 < self.seconds < 1e7:
            raise InputError(f"--seconds must be positive, got {self.seconds}")
        config = read_run_config(self.config)
        if self.disturbance:
            config = with_disturbance(config, self.disturbance)
        torch.set_num_threads(1)
        printed = timed_report()
        told = [printed]

        def report(line: str) -> None:
            for tell in told:
                tell(line)

        stream = self.stream()
        real_time_priority(report)
        with contextlib.ExitStack() as stack:
            folder, path = self.map_folder(config.navigation.map_half_size_m), WalkedPath()
            if folder is not None:
                stack.callback(folder.discard)
            car = stack.enter_context(open_car(config, report, self.go))
            stack.enter_context(emergency_stops(car.safe, car.ended))
            recorder = None
            if self.record is not None:
                recorder = stack.enter_context(Recorder(self.record, car.runner, report=report))
                car.observers.append(recorder)
            view = None
            if stream is not None:
                from ndtorch_robot.view import ViewSteps, start_view

                view = start_view(stream, car.runner, printed)
                stack.callback(view.close)
                observer = ViewSteps(view)
                car.observers.append(observer)
                told.append(observer.report)
            if folder is not None:
                car.observers.append(path)
            opening = Opening(report, car.runner, config.link)
            car.observers += stack.enter_context(open_bridges(config.bridges, opening))
            report(f"ready; {HELP}" if sys.stdin.isatty() else "ready; SIGUSR1: go, SIGTERM: stop and end")
            car.run(self.seconds)
            summary = car.summary() | world(car)
            if folder is not None:
                save_runner_map(folder.work, car.runner, path)
                folder.publish()
                summary["map"] = str(folder.final)
            if recorder is not None:
                recorder.close()
                summary["recording"] = recorder.summary()
            if view is not None:
                summary["view"] = {"shown": view.shown, "dropped": view.dropped, "failed": view.failed}
        if self.json:
            print(json.dumps(summary))
        else:
            for key, value in summary.items():
                print(f"{key}: {value}")
        half = None
        if self.rrd is not None:
            from ndtorch.report.recording import why_not_whole

            half = why_not_whole(self.rrd)
        if half is not None:
            print(f"error: {half}", file=sys.stderr)
        return INCOMPLETE if half is not None or (recorder is not None and recorder.failed) else 0

    def map_folder(self, half: float) -> RunFolder | None:
        """Where the map is to go; found out before the car drives."""
        from ndtorch.run.folder import RunFolder

        if self.save_map is None:
            return None
        if not half:
            raise InputError("--save-map needs a map: set map_half_size_m in [navigation], in m from the start")
        return RunFolder(self.save_map)

    def stream(self) -> Any:
        """Where the view goes; None where nobody looks."""
        where = (self.rrd, self.view, self.view_at)
        if not any(where):
            return None
        from ndtorch_robot.view import Where, layout, open_stream

        return open_stream(f"run {self.config.stem}", Where(*where), layout())


def with_disturbance(config: RunConfig, disturbance: str) -> RunConfig:
    if config.simulation is None:
        raise InputError("--disturbance is for simulated worlds, and this car has cameras")
    return config.model_copy(update={"simulation": config.simulation.model_copy(update={"disturbance": disturbance})})


def world(car: Car) -> dict[str, object]:
    """What the simulated world knows of the drive."""
    from ndtorch_robot.sim.simulation import Simulation
    from ndtorch_robot.sim.stepped_world import SteppedWorld

    if isinstance(car.cameras, SteppedWorld):
        simulation, distance = car.cameras.simulation, car.cameras.distance
        return {"collisions": len(simulation.collisions), "distance_m": round(distance, 2)}
    return {"collisions": len(car.cameras.collisions)} if isinstance(car.cameras, Simulation) else {}
