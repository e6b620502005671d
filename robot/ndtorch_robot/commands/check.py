"""`ndtorch check`."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ndtorch.errors import InputError

if TYPE_CHECKING:
    from ndtorch_robot.ports import Clock, Drive, Report
    from ndtorch_robot.run_config import RunConfig
    from ndtorch_robot.safety import SafeDrive

STEER = 1.0
"""Curvature of the test turns, 1/m."""

CRAWL = 0.2
"""Speed of the test drives with the wheels up, m/s."""

NEUTRAL = 1500
"""Pulse of the motor at rest, us."""


@dataclass(frozen=True)
class Check:
    """Walk through cameras, link, steering directions and emergency stop. Put the car on a block: wheels up!

    Asks after each movement whether it was the right one; exit code 1 when anything was not.
    """

    config: Annotated[Path, tyro.conf.Positional]
    """The car is described by this TOML file, or by one that is included, such as maxstone8."""
    yes: bool = False
    """Every question is answered with yes, for a simulated board."""
    json: bool = False
    """The points that were right are printed as one JSON object; all other output goes to stderr."""

    def run(self) -> int:
        from ndtorch_robot.link import Opening, open_link
        from ndtorch_robot.link.registry import MovesWorld
        from ndtorch_robot.loop import MonotonicClock
        from ndtorch_robot.run import make_simulation, timed_report
        from ndtorch_robot.run_config import read_run_config
        from ndtorch_robot.safety import SafeDrive

        config = read_run_config(self.config)
        self.say("1. Cameras")
        found = {"cameras": self.cameras(config)}
        self.say("2. Link")
        simulation = make_simulation(config)
        opening = Opening(config.board_name, lambda line: self.say(f"   {line}"), simulation)
        drive = open_link(config.link_table(), opening)
        clock: Clock = drive.cameras_and_clock()[1] if isinstance(drive, MovesWorld) else MonotonicClock()
        try:
            found["link"] = self.link(drive, clock)
            safe = SafeDrive(drive, clock, config.safety_limits(), report=timed_report())
            self.say("3. Directions")
            if not self.ask("Are all wheels off the ground?"):
                print("put the car on a block first", file=sys.stderr)
                return 1
            wrong = self.directions(safe)
            self.say("4. Emergency stop")
            stop = self.emergency(safe)
            found |= {"directions": wrong == 0, "emergency_stop": stop == 0}
        finally:
            drive.close()
            if simulation is not None:
                simulation.close()
        bad = (not found["cameras"]) + (not found["link"]) + wrong + stop
        if self.json:
            print(json.dumps(found | {"not_right": bad}))
        else:
            print("all well" if bad == 0 else f"{bad} of the points above were not right")
        return 0 if bad == 0 else 1

    def say(self, words: str, end: str = "\n") -> None:
        print(words, end=end, file=sys.stderr if self.json else sys.stdout, flush=True)

    def ask(self, question: str) -> bool:
        """Ask a question of yes or no; the end of the input is a no."""
        if self.yes:
            self.say(f"   {question} yes")
            return True
        try:
            # `input` would print the question on stdout.
            self.say(f"   {question} [y/n] ", end="")
            return input().strip().lower() in ("y", "yes")
        except EOFError:
            return False

    def cameras(self, config: RunConfig) -> bool:
        """Check rate, images and mounting of the cameras."""
        from ndtorch_robot.run import make_real_cameras

        if config.cameras is None:
            self.say("   simulated, nothing to check")
            return True
        try:
            import_module("ndtorch_robot.cameras")
            pair, rig, _ = make_real_cameras(config)
        except (InputError, ModuleNotFoundError) as error:
            self.say(f"   not right: {error}")
            return False
        from ndtorch_robot.camera_monitor import mounting_fault

        self.say("   for five seconds move the car about by hand: what both cameras see is compared")
        try:
            pairs = [pair.read() for _ in range(round(5 * config.rate_hz))]
        except InputError as error:
            self.say(f"   not right: {error}")
            return False
        finally:
            pair.close()
        wrong = mounting_fault(pairs, rig)
        if wrong is not None:
            self.say(f"   not right: {wrong}")
            return False
        times = [frames.time for frames in pairs]
        rate = (len(times) - 1) / (times[-1] - times[0])
        self.say(f"   {rate:.1f} pairs a second, {config.rate_hz:.0f} are wanted")
        return abs(rate / config.rate_hz - 1) < 0.1

    def link(self, drive: Drive, clock: Clock) -> bool:
        import numpy as np

        clock.wait_until(clock.now() + 1.0)
        said, trips = drive.telemetry(), np.array(drive.round_trips()) * 1e3
        if len(trips):
            self.say(f"   round trip {np.median(trips):.1f} ms, 99 % below {np.percentile(trips, 99):.1f} ms")
        if not {*said} - {"link"}:
            self.say("   not right: no telemetry")
            return False
        volts = said.get("battery_v", 0.0)
        self.say(f"   battery {f'{volts:.1f} V' if volts > 1 else 'not measured'}")
        pulses = [f"{name[:-3]} {said[name]} us" for name in said if name.endswith("_us")]
        self.say(f"   pulses {', '.join(pulses)}" if pulses else "   it reports no pulses")
        return True

    def directions(self, safe: SafeDrive) -> int:
        """Steer left, right, drive forward, backward; returns the number of wrong movements."""
        from ndtorch_robot.ports import DriveCommand

        moves = [
            (DriveCommand(0.0, STEER), "Did the front wheels turn left and the rear wheels right?"),
            (DriveCommand(0.0, -STEER), "Did the front wheels turn right and the rear wheels left?"),
            (DriveCommand(CRAWL, 0.0), "Did the wheels turn forward, slowly?"),
            (DriveCommand(-CRAWL, 0.0), "Did they turn backward, after a short brake?"),
        ]
        wrong = 0
        for command, question in moves:
            hold(safe, command, 1.5, self.say)
            wrong += not self.ask(question)
        return wrong

    def emergency(self, safe: SafeDrive) -> int:
        """Stop while driving; returns the number of faults."""
        from ndtorch_robot.ports import DriveCommand

        hold(safe, DriveCommand(CRAWL, 0.0), 1.0, self.say, stop=False)
        safe.emergency("test of the emergency stop")
        end = safe.clock.now() + 0.5
        while safe.clock.now() < end:
            safe.send(DriveCommand(CRAWL, 0.0))
            safe.clock.wait_until(safe.clock.now() + 0.03)
        said = safe.drive.telemetry()
        stopped = not said.get("armed", False) and said.get("motor_us", NEUTRAL) == NEUTRAL
        self.say(f"   the board reports that it {'is stopped' if stopped else 'drives'}")
        return (not stopped) + (not self.ask("Did the wheels stop at once?"))


def hold(safe: SafeDrive, command: object, seconds: float, report: Report, stop: bool = True) -> None:
    """Send a command for some seconds, through the safety layer as everything else."""
    from ndtorch_robot.ports import DriveCommand

    assert isinstance(command, DriveCommand)
    safe.send(DriveCommand(0.0, 0.0))
    safe.resume()
    sent, end = None, safe.clock.now() + seconds
    while safe.clock.now() < end:
        sent = safe.send(command)
        safe.clock.wait_until(safe.clock.now() + 0.03)
    if sent != command:
        report(f"   not right: {command} was wanted, {sent} was sent")
    if stop:
        safe.stop()
