"""Command line of the robot."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from ndtorch.commands import run_subcommand
from robot.commands.arenas import Arenas
from robot.commands.calibrate import Calibrate
from robot.commands.cameras import Cameras
from robot.commands.check import Check
from robot.commands.drive import Drive
from robot.commands.evaluate import Evaluate
from robot.commands.replay import Replay
from robot.commands.run import Run

COMMANDS = {
    "drive": Drive,
    "arenas": Arenas,
    "evaluate": Evaluate,
    "cameras": Cameras,
    "calibrate": Calibrate,
    "replay": Replay,
    "run": Run,
    "check": Check,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `python -m robot ...`; returns the exit code: 0, 2 for unusable input, 130 for Ctrl-C."""
    return run_subcommand("python -m robot", "The robot, and a simulated building for it.", COMMANDS, arguments)


if __name__ == "__main__":
    sys.exit(main())
