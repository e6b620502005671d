"""`ndtorch check`."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ndtorch.errors import InputError
from ndtorch_robot.ports import Clock, Drive, DriveCommand

if TYPE_CHECKING:
    from ndtorch_robot.run_config import RunConfig
    from ndtorch_robot.safety import SafeDrive

CRAWL, NEUTRAL_US = 0.2, 1500
"""Speed of the test drives with the wheels up, m/s, and pulse of the motor at rest, us."""

MOVES = (
    ((0.0, 1.0), "Did the front wheels turn left and the rear wheels right?"),
    ((0.0, -1.0), "Did the front wheels turn right and the rear wheels left?"),
    ((CRAWL, 0.0), "Did the wheels turn forward, slowly?"),
    ((-CRAWL, 0.0), "Did they turn backward, after a short brake?"),
)
"""Speed, m/s, and curvature, 1/m, of a test, and what must have happened."""


@dataclass(frozen=True)
class Check:
    """Walk through cameras, link, steering directions and emergency stop. Put the car on a block: wheels up!

    Asks after each movement whether it was the right one, of a simulated car what it reports; exit code 1 when anything
    was not.
    """

    config: Annotated[Path, tyro.conf.Positional]
    """TOML file of the car, or the name of one that is included, such as maxstone8."""
    yes: bool = False
    """Answer yes to every question, for a simulated board."""
    json: bool = False
    """Print the points that were right as one JSON object; all other output goes to stderr."""

    def run(self) -> int:
        from ndtorch_robot.run import open_drive, timed_report
        from ndtorch_robot.run_config import read_run_config
        from ndtorch_robot.safety import SafeDrive

        config = read_run_config(self.config).for_run()
        self.say("1. Cameras")
        good = {"cameras": self.cameras(config)}
        self.say("2. Link")
        with open_drive(config, lambda line: self.say(f"   {line}")) as (drive, clock, _):
            good["link"] = self.link(drive, clock)
            safe = SafeDrive(drive, clock, config.safety_limits, report=timed_report())
            self.say("3. Directions")
            # Of a simulated car nobody can see its wheels: what it reports decides.
            ask = self.ask if config.simulation is None else lambda question: True
            if not ask("Are all wheels off the ground?"):
                print("put the car on a block first", file=sys.stderr)
                return 1
            good["directions"] = sum(self.move(safe, *move, ask) for move in MOVES) == len(MOVES)
            self.say("4. Emergency stop")
            good["emergency_stop"] = self.emergency(safe, ask)
        wrong = [name.replace("_", " ") for name, right in good.items() if not right]
        words = f"not right: {', '.join(wrong)}" if wrong else "all well"
        print(json.dumps(good) if self.json else words)
        return 1 if wrong else 0

    def say(self, words: str, end: str = "\n") -> None:
        print(words, end=end, file=sys.stderr if self.json else sys.stdout, flush=True)

    def ask(self, question: str) -> bool:
        self.say(f"   {question} " + ("yes" if self.yes else "[y/n] "), end="\n" if self.yes else "")
        try:
            return self.yes or input().strip().lower() in ("y", "yes")
        except EOFError:
            return False

    def cameras(self, config: RunConfig) -> bool:
        import numpy as np

        from ndtorch_robot.camera_monitor import mounting_fault
        from ndtorch_robot.run import open_real_cameras

        if config.cameras is None:
            self.say("   simulated, nothing to check")
            return True
        try:
            cameras, rig = open_real_cameras(config)
            self.say("   for five seconds move the car about by hand: what both cameras see is compared")
            with cameras:
                pairs = [cameras.read() for _ in range(round(5 * config.rate_hz))]
        except InputError as error:
            self.say(f"   not right: {error}")
            return False
        rate = (len(pairs) - 1) / (pairs[-1].time - pairs[0].time)
        skew = 1e3 * float(np.median(np.abs(cameras.pairing.skews)))
        self.say(f"   {rate:.1f} pairs a second, {config.rate_hz:.0f} are wanted; both sides {skew:.1f} ms apart")
        wrong = mounting_fault(pairs, rig)
        if wrong is not None:
            self.say(f"   not right: {wrong}")
        return wrong is None and abs(rate / config.rate_hz - 1) < 0.1

    def link(self, drive: Drive, clock: Clock) -> bool:
        from ndtorch_robot.car import percentiles_ms

        clock.wait_until(clock.now() + 1.0)
        telemetry = drive.telemetry()
        simulated = drive.cameras_and_clock() is not None
        times = {} if simulated else {"round_trip_ms": percentiles_ms(drive.round_trips())}
        for name, value in (telemetry | times).items():
            self.say(f"   {name} {value}")
        return simulated or bool({*telemetry} - {"link"})

    def move(self, safe: SafeDrive, motion: tuple[float, float], question: str, ask: Callable[[str], bool]) -> bool:
        """Send a motion for some seconds, through the safety layer as everything else, and ask for it."""
        safe.wait_for_start(go=True)
        fastest = safe.limits.speed_m_per_s
        motion = (min(max(motion[0], -fastest), fastest), motion[1])
        send(safe, motion, 1.5)
        right = safe.sent == motion or ask == self.ask
        if safe.sent != motion:
            self.say(f"   not right: {motion} was wanted, {safe.sent} was sent")
        safe.stop()
        return right and ask(question)

    def emergency(self, safe: SafeDrive, ask: Callable[[str], bool]) -> bool:
        safe.wait_for_start(go=True)
        send(safe, (CRAWL, 0.0), 1.0)
        safe.emergency("test of the emergency stop")
        send(safe, (CRAWL, 0.0), 0.5)
        telemetry = safe.drive.telemetry()
        stopped = not telemetry.get("armed", False) and telemetry.get("motor_us", NEUTRAL_US) == NEUTRAL_US
        self.say(f"   the board reports that it {'is stopped' if stopped else 'drives'}")
        return ask("Did the wheels stop at once?") and stopped


def send(safe: SafeDrive, motion: tuple[float, float], seconds: float) -> None:
    end = safe.clock.now() + seconds
    while safe.clock.now() < end:
        safe.send(DriveCommand(*motion))
        safe.clock.wait_until(safe.clock.now() + 0.03)
