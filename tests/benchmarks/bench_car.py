"""The running car: round trips of the link, jitter of the loop, and from the frame to the command.

The real loop, link and firmware, the latter on a simulated processor; the cameras are two films. Everything runs with
the priority that `ndtorch run` asks for.

`python -m tests.benchmarks.bench_car [--seconds 20] [--controller published]`
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import torch

from ndtorch.navigation.controllers import DEFAULT_CONTROLLER, controller_names
from ndtorch_robot.car import percentiles
from ndtorch_robot.link.serial_drive import SerialDrive
from ndtorch_robot.run import open_car, real_time_priority
from ndtorch_robot.run_config import NavigationTable, RunConfig
from tests.benchmarks.bench_cameras import films
from tests.benchmarks.timing import Row, table
from tests.robot.support.avr_board import AvrBoard
from tests.robot.support.peer import Peer, board

TITLE = "The running car (firmware on a simulated processor, two 640x480 films)"
SECONDS = 20.0


def bare_line(seconds: float) -> dict[str, float]:
    """Round trips, ms, with somebody at the other end of a pty who answers at once."""
    peer = Peer(board)
    drive = SerialDrive(peer.device, report=lambda line: None)
    time.sleep(seconds)
    trips = np.array(drive.round_trips()) * 1e3
    drive.close()
    peer.close()
    return percentiles(trips)


def car(seconds: float, controller: str) -> dict[str, object]:
    """The summary of a run: see `ndtorch_robot.car.Car.summary`."""
    lines: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        left, right = films(Path(folder), round(30 * (seconds + 2)))
        simulated = AvrBoard()
        try:
            link = {"device": simulated.device}
            navigation = NavigationTable(controller=controller)
            config = RunConfig(
                board_name="maxston8", cameras={"left": left, "right": right}, link=link, navigation=navigation
            )
            with open_car(config, lines.append, go=True) as running:
                running.run(seconds)
                return running.summary()
        finally:
            simulated.close()


def rows(seconds: float = SECONDS, controller: str = DEFAULT_CONTROLLER) -> list[Row]:
    """The table."""
    cv2.setNumThreads(1)
    said: list[str] = []
    real_time_priority(said.append)
    try:
        bare, summary = bare_line(min(seconds, 10.0)), car(seconds, controller)
    finally:
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    note = " (no real-time priority)" if said else ""
    parts = summary["parts_ms"]
    assert isinstance(parts, dict)
    wanted = (
        ("link round trip on a bare pty", bare, 2.0),
        ("link round trip through the simulated board", summary["round_trip_ms"], 10.0),
        ("loop jitter at 30 Hz", summary["jitter_ms"], 5.0),
        ("camera frame to command", parts["frame to command"], 10.0),
    )
    return [
        Row(
            f"{what}{note}: median and 99 %",
            f"{found['p50']:.2f}, {found['p99']:.2f} ms",
            f"{limit:g} ms",
            f"{limit / found['p99']:.1f}x",
        )
        for what, found, limit in wanted
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("--controller", choices=controller_names(), default=DEFAULT_CONTROLLER)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    print(table(TITLE, rows(asked.seconds, asked.controller)))
