"""The firmware's binary on a simulated processor, in a process of its own and in real time, as a link of a car.

`python -m tests.robot.support.avr_board run CONFIG` is `ndtorch run CONFIG` with this link.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from pathlib import Path

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict
from ndtorch_robot.car import MonotonicClock
from ndtorch_robot.link import Opening, link
from ndtorch_robot.link.board import Pulse
from ndtorch_robot.link.serial_drive import SerialDrive
from ndtorch_robot.ports import CameraPair, Clock, Report, StereoFrames
from ndtorch_robot.sim.firmware_host import FIRMWARE, Electronics
from ndtorch_robot.sim.simulation import Simulation

SIMULATOR, IMAGE = FIRMWARE / "build" / "avrsim", FIRMWARE / "build" / "firmware.elf"


class AvrBoard:
    """Runs `robot/firmware/sim/avrsim.c` and keeps what it says, also in a file, `log`.

    `device` is the path of its serial port; `events` are the commands that it carried out, such as `"stall"`, and when.
    """

    def __init__(self, log: Path | None = None) -> None:
        if not SIMULATOR.exists() or not IMAGE.exists():
            raise InputError(
                f"the simulated board is not built: make -C {FIRMWARE} sim "
                "(Debian: gcc-avr avr-libc libsimavr-dev libelf-dev)"
            )
        self.folder = tempfile.TemporaryDirectory(prefix="board-")
        self.device = str(Path(self.folder.name) / "serial")
        arguments = [str(SIMULATOR), str(IMAGE), self.device, *([str(log)] if log else [])]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        # A session of its own: Ctrl-C is for the loop.
        self.process = subprocess.Popen(arguments, **pipes, text=True, bufsize=1, start_new_session=True)
        self.pulses: list[Pulse] = []
        self.queues: list[deque[Pulse]] = []
        self.events: list[tuple[str, float]] = []
        self.ready = threading.Event()
        self.thread = threading.Thread(target=self.read, name="board", daemon=True)
        self.thread.start()
        if not self.ready.wait(10.0):
            self.close()
            raise InputError("the simulated board does not start")

    def read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            parts = line.split()
            if line.startswith("P "):
                pulse = Pulse(parts[1], float(parts[2]), int(parts[4]) / 1e9)
                self.pulses.append(pulse)
                for queue in self.queues:
                    queue.append(pulse)
            elif line.startswith("F "):
                self.events.append((parts[1], int(parts[2]) / 1e9))
            elif line.startswith("R "):
                self.ready.set()

    def command(self, line: str) -> float:
        """Carry out a command (see avrsim.c); returns when that happened, s on the monotonic clock."""
        assert self.process.stdin is not None
        wanted, count = line.strip().replace(" ", "-"), len(self.events)
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        end = time.monotonic() + 5.0
        while time.monotonic() < end:
            for name, when in self.events[count:]:
                if name == wanted:
                    return when
            time.sleep(0.001)
        raise InputError(f"the simulated board did not do {line!r}")

    def close(self) -> None:
        if self.process.poll() is None:
            assert self.process.stdin is not None
            try:
                self.process.stdin.write("quit\n")
                self.process.stdin.close()
                self.process.wait(3.0)
            except (OSError, subprocess.TimeoutExpired):
                self.process.kill()
        self.process.wait()
        self.thread.join(2.0)
        assert self.process.stdout is not None
        self.process.stdout.close()
        self.folder.cleanup()


class RealtimeWorld:
    """Cameras of `Simulation` in real time; its car does what the board's pulses say, at the times they came.

    Implements `ports.CameraPair`. Pictures are drawn when they are asked for, so the time of a frame is that
    of asking.
    """

    def __init__(self, simulation: Simulation, board: AvrBoard) -> None:
        self.simulation, self.board = simulation, board
        self.electronics = Electronics()
        self.start = time.monotonic() - simulation.now()
        self.queue: deque[Pulse] = deque()
        board.queues.append(self.queue)
        self.distance = 0.0

    def read(self) -> StereoFrames:
        """What both cameras see now, or with the next frame that is not lost; late frames have the time they tell."""
        self.catch_up()
        frames = self.simulation.read(lambda _: self.catch_up(1 / self.simulation.rate))
        return frames._replace(time=self.now - (self.simulation.now() - frames.time))

    def catch_up(self, after: float = 0.0) -> None:
        time.sleep(after)
        self.now = time.monotonic()
        while self.queue and self.queue[0].time <= self.now:
            pulse = self.queue.popleft()
            self.advance(pulse.time)
            self.electronics.apply(pulse)
        self.advance(self.now)

    def advance(self, now: float) -> None:
        car, before = self.simulation.car, self.simulation.now()
        self.simulation.obey(self.electronics.target(now))
        self.simulation.wait_until(now - self.start)
        self.distance += abs(car.speed) * (self.simulation.now() - before)

    def close(self) -> None:
        self.simulation.close()


class BoardSettings(Strict):
    """`[link]` with `kind = "avr-board"`, and a file for every pulse that the board makes."""

    pulse_log: Path | None = None


class BoardDrive(SerialDrive):
    """A `SerialDrive` that has its board with it."""

    def __init__(self, board: AvrBoard, robot: str, report: Report, simulation: Simulation | None) -> None:
        self.board, self.simulation = board, simulation
        super().__init__(board.device, board_name=robot, report=report)

    def cameras_and_clock(self) -> tuple[CameraPair, Clock]:
        assert self.simulation is not None
        return RealtimeWorld(self.simulation, self.board), MonotonicClock()

    def close(self) -> None:
        super().close()
        self.board.close()


@link("avr-board")
def open_board(settings: BoardSettings, opening: Opening) -> BoardDrive:
    board = AvrBoard(settings.pulse_log)
    try:
        return BoardDrive(board, opening.board_name, opening.report, opening.simulation)
    except BaseException:
        board.close()
        raise


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
