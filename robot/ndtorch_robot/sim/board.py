"""The firmware on a simulated processor: a process of its own, in real time, whose pulses can be read."""

from __future__ import annotations

import re
import subprocess
import tempfile
import threading
import time
from collections import deque
from pathlib import Path
from typing import NamedTuple

from ndtorch.errors import InputError
from ndtorch.installed import folder_of

FIRMWARE = folder_of("ndtorch_robot", "firmware")
SIMULATOR, IMAGE = FIRMWARE / "build" / "avrsim", FIRMWARE / "build" / "firmware.elf"


def shown(path: Path) -> Path:
    """The path from here, where that is shorter."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path


class Pulse(NamedTuple):
    """One pulse: `"motor"`, `"front"` or `"rear"`, its width in us, and when it ended, s on the monotonic clock."""

    name: str
    width: float
    time: float


class Event(NamedTuple):
    """A command the simulator carried out (`"stall"`, `"up-garbage"`), or `"late"`, when, and how late, s."""

    name: str
    time: float
    late: float = 0.0


def constants() -> dict[str, int]:
    """The numbers of the firmware's `config.h`."""
    text = (FIRMWARE / "config.h").read_text()
    return {name: int(value) for name, value in re.findall(r"#define (\w+) \(?(-?\d+)", text)}


class SimulatedBoard:
    """Runs `robot/firmware/sim/avrsim.c` and keeps what it says.

    Args:
        log: file for all it says; it goes on for a second when this process is killed.

    Raises:
        InputError: the simulator was not built.

    Attributes:
        device: path of the serial port.
        pulses, events: all so far; of `pulses` the last two minutes.
    """

    KEPT = 20_000

    def __init__(self, log: Path | None = None) -> None:
        if not SIMULATOR.exists() or not IMAGE.exists():
            raise InputError(
                f"the simulated board is not built: make -C {shown(FIRMWARE)} sim "
                "(Debian: gcc-avr avr-libc libsimavr-dev libelf-dev)"
            )
        self.folder = tempfile.TemporaryDirectory(prefix="board-")
        self.device = str(Path(self.folder.name) / "serial")
        arguments = [str(SIMULATOR), str(IMAGE), self.device, *([str(log)] if log else [])]
        self.process = subprocess.Popen(
            arguments,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            bufsize=1,
            start_new_session=True,  # Ctrl-C is for the loop
        )
        self.pulses: list[Pulse] = []
        self.queues: list[deque[Pulse]] = []
        self.events: list[Event] = []
        self.ready = threading.Event()
        self.thread = threading.Thread(target=self.read, name="board", daemon=True)
        self.thread.start()
        if not self.ready.wait(10.0):
            self.close()
            raise InputError("the simulated board does not start")

    def read(self) -> None:
        """Everything the simulator prints."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            parts = line.split()
            if line.startswith("P "):
                pulse = Pulse(parts[1], float(parts[2]), int(parts[4]) / 1e9)
                self.pulses.append(pulse)
                for queue in self.queues:
                    queue.append(pulse)
                if len(self.pulses) > self.KEPT:
                    del self.pulses[: self.KEPT // 2]
            elif line.startswith("F "):
                self.events.append(Event(parts[1], int(parts[2]) / 1e9))
            elif line.startswith("L "):
                self.events.append(Event("late", int(parts[2]) / 1e9, int(parts[1]) / 1e6))
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
            for event in self.events[count:]:
                if event.name == wanted:
                    return event.time
            time.sleep(0.001)
        raise InputError(f"the simulated board did not do {line!r}")

    def queue(self) -> deque[Pulse]:
        """Where every pulse from now on is put, for one reader who takes them out."""
        queue: deque[Pulse] = deque()
        self.queues.append(queue)
        return queue

    def close(self) -> None:
        """End the process."""
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
