"""`ndtorch check`."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ndtorch.errors import InputError

if TYPE_CHECKING:
    from ndtorch_robot.ports import Clock, Drive
    from ndtorch_robot.run_config import RunConfig
    from ndtorch_robot.safety import SafeDrive

STEER, CRAWL = 1.0, 0.2
"""Curvature of the test turns, 1/m, and speed of the test drives with the wheels up, m/s."""

NEUTRAL_US = 1500
"""Pulse of the motor at rest, us."""

MOVES = (
    ((0.0, STEER), "Did the front wheels turn left and the rear wheels right?"),
    ((0.0, -STEER), "Did the front wheels turn right and the rear wheels left?"),
    ((CRAWL, 0.0), "Did the wheels turn forward, slowly?"),
    ((-CRAWL, 0.0), "Did they turn backward, after a short brake?"),
)
"""Speed, m/s, and curvature, 1/m, of a test, and what must have happened."""


@dataclass(frozen=True)
class Check:
    """Walk through cameras, link, steering directions and emergency stop. Put the car on a block: wheels up!

    Asks after each movement whether it was the right one; exit code 1 when anything was not.
    """

    config: Annotated[Path, tyro.conf.Positional]
    """TOML file of the car, or the name of one that is included, such as maxstone8."""
    yes: bool = False
    """Answer yes to every question, for a simulated board."""
    json: bool = False
    """Print the points that were right as one JSON object; all other output goes to stderr."""

    def run(self) -> int:
        from ndtorch_robot.car import MonotonicClock
        from ndtorch_robot.link import MovesWorld, Opening, open_link
        from ndtorch_robot.run import make_simulation, timed_report
        from ndtorch_robot.run_config import read_run_config
        from ndtorch_robot.safety import SafeDrive

        config = read_run_config(self.config)
        self.say("1. Cameras")
        good = {"cameras": self.cameras(config)}
        self.say("2. Link")
        simulation = make_simulation(config)
        opening = Opening(config.board_name, lambda line: self.say(f"   {line}"), simulation)
        drive = open_link(config.link_table(), opening)
        clock: Clock = drive.cameras_and_clock()[1] if isinstance(drive, MovesWorld) else MonotonicClock()
        try:
            good["link"] = self.link(drive, clock)
            safe = SafeDrive(drive, clock, config.safety_limits, report=timed_report())
            self.say("3. Directions")
            if not self.ask("Are all wheels off the ground?"):
                print("put the car on a block first", file=sys.stderr)
                return 1
            good["directions"] = sum(self.move(safe, *move) for move in MOVES) == len(MOVES)
            self.say("4. Emergency stop")
            good["emergency_stop"] = self.emergency(safe)
        finally:
            drive.close()
            if simulation is not None:
                simulation.close()
        wrong = [name.replace("_", " ") for name, right in good.items() if not right]
        if self.json:
            print(json.dumps(good))
        else:
            print(f"not right: {', '.join(wrong)}" if wrong else "all well")
        return 1 if wrong else 0

    def say(self, words: str, end: str = "\n") -> None:
        print(words, end=end, file=sys.stderr if self.json else sys.stdout, flush=True)

    def ask(self, question: str) -> bool:
        """Ask a question of yes or no; the end of the input is a no."""
        if self.yes:
            self.say(f"   {question} yes")
            return True
        try:
            self.say(f"   {question} [y/n] ", end="")  # `input` would print it on stdout
            return input().strip().lower() in ("y", "yes")
        except EOFError:
            return False

    def cameras(self, config: RunConfig) -> bool:
        """Check rate, images and mounting of the cameras."""
        from ndtorch_robot.camera_monitor import mounting_fault
        from ndtorch_robot.run import make_real_cameras

        if config.cameras is None:
            self.say("   simulated, nothing to check")
            return True
        try:
            pair, rig, _ = make_real_cameras(config)
            self.say("   for five seconds move the car about by hand: what both cameras see is compared")
            try:
                pairs = [pair.read() for _ in range(round(5 * config.rate_hz))]
            finally:
                pair.close()
        except InputError as error:
            self.say(f"   not right: {error}")
            return False
        wrong = mounting_fault(pairs, rig)
        if wrong is not None:
            self.say(f"   not right: {wrong}")
            return False
        rate = (len(pairs) - 1) / (pairs[-1].time - pairs[0].time)
        self.say(f"   {rate:.1f} pairs a second, {config.rate_hz:.0f} are wanted")
        return abs(rate / config.rate_hz - 1) < 0.1

    def link(self, drive: Drive, clock: Clock) -> bool:
        """Round trip, battery and pulses after a second."""
        import numpy as np

        clock.wait_until(clock.now() + 1.0)
        telemetry, trips = drive.telemetry(), np.array(drive.round_trips()) * 1e3
        if len(trips):
            self.say(f"   round trip {np.median(trips):.1f} ms, 99 % below {np.percentile(trips, 99):.1f} ms")
        if not {*telemetry} - {"link"}:
            self.say("   not right: no telemetry")
            return False
        volts = telemetry.get("battery_v", 0.0)
        self.say(f"   battery {f'{volts:.1f} V' if volts > 1 else 'not measured'}")
        pulses = [f"{name[:-3]} {telemetry[name]} us" for name in telemetry if name.endswith("_us")]
        self.say(f"   pulses {', '.join(pulses)}" if pulses else "   it reports no pulses")
        return True

    def move(self, safe: SafeDrive, motion: tuple[float, float], question: str) -> bool:
        """Send a motion for some seconds, through the safety layer as everything else, and ask for it."""
        safe.wait_for_start(go=True)
        send(safe, motion, 1.5)
        if safe.sent != motion:
            self.say(f"   not right: {motion} was wanted, {safe.sent} was sent")
        safe.stop()
        return self.ask(question)

    def emergency(self, safe: SafeDrive) -> bool:
        """Stop while driving."""
        safe.wait_for_start(go=True)
        send(safe, (CRAWL, 0.0), 1.0)
        safe.emergency("test of the emergency stop")
        send(safe, (CRAWL, 0.0), 0.5)
        telemetry = safe.drive.telemetry()
        stopped = not telemetry.get("armed", False) and telemetry.get("motor_us", NEUTRAL_US) == NEUTRAL_US
        self.say(f"   the board reports that it {'is stopped' if stopped else 'drives'}")
        return self.ask("Did the wheels stop at once?") and stopped


def send(safe: SafeDrive, motion: tuple[float, float], seconds: float) -> None:
    """Ask for a speed and a curvature again and again."""
    from ndtorch_robot.ports import DriveCommand

    end = safe.clock.now() + seconds
    while safe.clock.now() < end:
        safe.send(DriveCommand(*motion))
        safe.clock.wait_until(safe.clock.now() + 0.03)
