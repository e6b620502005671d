"""`ndtorch run`."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from ndtorch.cli.command_run import INCOMPLETE
from ndtorch.errors import InputError
from ndtorch_robot.config import Recorded


@dataclass(frozen=True)
class Run(Recorded):
    """Drive a car: cameras, navigator, safety layer and board, in real time.

    The car stands until the key g is pressed (or SIGUSR1 comes); any other key is an emergency stop. SIGINT and
    SIGTERM stop the car and end the program.
    """

    config: Annotated[Path, tyro.conf.Positional]
    """TOML file of the car, or the name of one that is included: maxstone8, or sim for one without hardware."""
    seconds: float | None = None
    """Time after which the drive ends, in s (default: on SIGTERM)."""
    go: bool = False
    """Drive off without waiting for the key."""
    whole_frames: bool = False
    """Record whole frames instead of what navigation reads of them."""
    save_map: Path | None = None
    """Folder for the map at the end, if navigation.map_half_size_m is above 0."""
    json: bool = False
    """Print the summary as one JSON object, and nothing else on stdout."""

    def run(self) -> int:
        import torch

        from ndtorch.report.recording import why_not_whole
        from ndtorch.run.folder import RunFolder
        from ndtorch_robot.emergency import HELP, emergency_stops
        from ndtorch_robot.navigator_runner import WalkedPath, save_runner_map
        from ndtorch_robot.run import observe, open_car, real_time_priority, timed_report
        from ndtorch_robot.run_config import read_run_config

        if self.seconds is not None and not self.seconds > 0:
            raise InputError(f"--seconds must be positive, got {self.seconds}")
        config = read_run_config(self.config).for_run()
        if self.save_map is not None and not config.navigation.map_half_size_m:
            raise InputError("--save-map needs a map: set map_half_size_m in [navigation], in m from the start")
        torch.set_num_threads(1)
        printed, path, folder = timed_report(), WalkedPath(), None
        reports = [printed]

        def report(line: str) -> None:
            for show in reports:
                show(line)

        real_time_priority(report)
        with contextlib.ExitStack() as stack:
            if self.save_map is not None:
                folder = RunFolder(self.save_map)
                stack.callback(folder.discard)
            car = stack.enter_context(open_car(config, report, self.go))
            stack.enter_context(emergency_stops(car.safe, car.ended))
            observed = observe(car, f"run {self.config.stem}", self, printed, self.whole_frames)
            recorder, view = stack.enter_context(observed)
            if view is not None:
                reports.append(view.report)
            car.observers.append(path)
            if config.ros2 is not None:
                from ndtorch_robot.ros2 import Ros2Bridge

                car.observers.append(stack.enter_context(Ros2Bridge(config.ros2, car.runner, report)))
            report(f"ready; {HELP if sys.stdin.isatty() else 'SIGUSR1: go, SIGTERM: stop and end'}")
            car.run(self.seconds)
            summary = car.summary()
            world = getattr(car.cameras, "simulation", car.cameras)
            if hasattr(world, "collisions"):
                summary["collisions"] = len(world.collisions)
            if folder is not None:
                save_runner_map(folder.work, car.runner, path)
                folder.publish()
                summary["map"] = str(folder.final)
        if recorder is not None:
            summary["recording"] = recorder.summary()
        if view is not None:
            summary["view"] = {"shown": view.shown, "dropped": view.dropped, "failed": view.failed}
        print(json.dumps(summary) if self.json else "\n".join(summary_lines(summary)))
        half = None if self.rrd is None else why_not_whole(self.rrd)
        if half is not None:
            print(f"error: {half}", file=sys.stderr)
        return INCOMPLETE if half is not None or (recorder is not None and recorder.failed) else 0


def summary_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """The summary of a car for people: what it drove, every fault, and how long things took."""
    hits = f", {summary['collisions']} collisions" if "collisions" in summary else ""
    yield f"{summary['distance_m']:.2f} m{hits}, {summary['steps']} steps, {summary['late']} of them late"
    yield f"{summary['clamped']} commands were beyond the limits and clamped"
    yield from (f"fault at {fault['time_s']:.2f} s: {fault['why']}" for fault in summary["faults"])
    yield from (f"stood: {trouble}" for trouble in summary["troubles"])
    times = {"round trip": summary["round_trip_ms"], "jitter": summary["jitter_ms"], **summary["parts_ms"]}
    for name, one in times.items():
        if one:
            yield f"{name:<20}median {one['p50']:.2f} ms, 99 % below {one['p99']:.2f} ms, largest {one['max']:.2f} ms"
    yield from (f"{name}: {summary[name]}" for name in ("map", "recording") if name in summary)
