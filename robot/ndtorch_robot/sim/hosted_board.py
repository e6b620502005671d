"""The firmware's own code as a library on this computer, in whatever time the caller keeps."""

from __future__ import annotations

import ctypes
import hashlib
import shutil
import subprocess
import tempfile
from pathlib import Path

from ndtorch.errors import InputError
from ndtorch_robot.sim.board import FIRMWARE, Pulse

SOURCES = ("sim/hosted.c", "protocol.c", "drive.c")

ROOM = 8192
"""Bytes of answers that fit into one call: a second of telemetry is 2 kB."""

NAMES = ("motor", "front", "rear")

PERIOD_MS = 20
"""The pulses of servos begin so often: what the board decides in between waits for the next."""


class HostedBoard:
    """`protocol.c` and `drive.c`, compiled for this computer, with the main loop of `main.c` around them.

    What is not in here is the processor: interrupts, the timers of the pulses and the watchdog timer. Those are tested
    with `SimulatedBoard`, which is bound to real time.

    Raises:
        InputError: no C compiler, or one that cannot compile the firmware.
    """

    def __init__(self) -> None:
        compiler = shutil.which("cc") or shutil.which("gcc")
        if compiler is None:
            raise InputError("the board's code has to be compiled for this computer, and there is no C compiler (cc)")
        with tempfile.TemporaryDirectory(prefix="board-") as folder:
            made = Path(folder) / "board.so"
            sources = [str(FIRMWARE / name) for name in SOURCES]
            command = [compiler, "-std=c11", "-O1", "-shared", "-fPIC", "-o", str(made), *sources]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise InputError(f"the board's code cannot be compiled: {done.stderr.strip().splitlines()[-1:]}")
            self.library = ctypes.CDLL(str(made))  # stays loaded when its file is gone
        self.library.board_new.restype = ctypes.c_void_p
        self.board: ctypes.c_void_p | None = None
        self.reset(0.0)
        self.out = ctypes.create_string_buffer(ROOM)
        self.widths = (ctypes.c_uint16 * 3)()
        self.period = 0

    def reset(self, now: float) -> None:
        """Switch it off and on at this time, s: it has forgotten everything."""
        self.close()
        self.board = ctypes.c_void_p(self.library.board_new(ctypes.c_uint32(round(now * 1e3))))

    @staticmethod
    def code() -> str:
        """A hash of what it is compiled from."""
        texts = (FIRMWARE / name for name in (*SOURCES, "config.h", "drive.h", "protocol.h"))
        return hashlib.sha256(b"".join(text.read_bytes() for text in texts)).hexdigest()

    def run(self, now: float, data: bytes = b"") -> tuple[bytes, list[Pulse]]:
        """Go on until a time, s; these bytes come just before it. Returns answers, and ended pulses."""
        ms = round(now * 1e3)
        count = self.library.board_run(
            self.board, ctypes.c_uint32(ms), data, ctypes.c_uint(len(data)), self.out, ctypes.c_uint(ROOM)
        )
        if ms // PERIOD_MS == self.period:
            return self.out.raw[:count], []
        self.period = ms // PERIOD_MS
        self.library.board_pulses(self.board, self.widths)
        return self.out.raw[:count], [Pulse(name, width, now) for name, width in zip(NAMES, self.widths, strict=True)]

    def close(self) -> None:
        """Give its memory back. Calling it again does nothing."""
        board, self.board = self.board, None
        if board is not None:
            self.library.board_free(board)
