"""The firmware's own code in this process, and the servos and motor controller that its pulses drive."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path

from ndtorch.errors import InputError
from ndtorch.utils.packages import folder_of
from ndtorch_robot.link.board import NAMES, BoardSettings, Pulse
from ndtorch_robot.ports import DriveCommand

FIRMWARE = folder_of("ndtorch_robot", "firmware")

BUFFER_BYTES, SIGNAL_LOST = 8192, 0.1
"""Bytes of answers of one call, and seconds without pulses after which servos and motor controllers stop."""


class FirmwareHost:
    """`protocol.c` and `drive.c`, compiled for this computer, with the main loop of `main.c` around them.

    The processor is missing: interrupts, the timers of the pulses and the watchdog timer.

    Raises:
        InputError: no C compiler, or one that cannot compile the firmware.
    """

    def __init__(self) -> None:
        compiler = shutil.which("cc") or shutil.which("gcc")
        if compiler is None:
            raise InputError("the board's code has to be compiled for this computer, and there is no C compiler (cc)")
        with tempfile.TemporaryDirectory(prefix="board-") as folder:
            made = Path(folder) / "board.so"
            sources = [str(FIRMWARE / name) for name in ("sim/hosted.c", "protocol.c", "drive.c")]
            command = [compiler, "-std=c11", "-O1", "-shared", "-fPIC", "-o", str(made), *sources]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise InputError(f"the board's code cannot be compiled: {done.stderr.strip().splitlines()[-1:]}")
            self.library = ctypes.CDLL(str(made))  # stays loaded when its file is gone
        self.library.board_new.restype = ctypes.c_void_p
        self.board: ctypes.c_void_p | None = None
        self.reset(0.0)
        self.out = ctypes.create_string_buffer(BUFFER_BYTES)
        self.widths = (ctypes.c_uint16 * 3)()

    def reset(self, now: float) -> None:
        """Switch it off and on at this time, s: it has forgotten everything."""
        self.close()
        self.board = ctypes.c_void_p(self.library.board_new(ctypes.c_uint32(round(now * 1e3))))

    def run(self, now: float, data: bytes = b"") -> bytes:
        """Go on until a time, s; these bytes come just before it. Returns answers."""
        until = ctypes.c_uint32(round(now * 1e3))
        given = until, data, ctypes.c_uint(len(data)), self.out, ctypes.c_uint(BUFFER_BYTES)
        count = self.library.board_run(self.board, *given)
        self.library.board_pulses(self.board, self.widths)
        return self.out.raw[:count]

    def close(self) -> None:
        board, self.board = self.board, None
        if board is not None:
            self.library.board_free(board)


class Electronics:
    """Servos and motor controller: from pulse widths to speed and curvature.

    The motor controller takes pulses below neutral for the brake until it has seen neutral after braking; then they
    are reverse, until the car drives forward again.
    """

    def __init__(self) -> None:
        self.settings = BoardSettings()
        self.widths = dict.fromkeys(NAMES, 1500.0)
        self.braked = self.reverse = False
        self.time = 0.0

    def apply(self, pulse: Pulse) -> None:
        self.widths[pulse.name] = pulse.width
        self.time = pulse.time
        if pulse.name == "motor":
            offset, dead_band = pulse.width - self.settings.motor_neutral_us, self.settings.motor_dead_band_us
            if offset > dead_band:
                self.braked = self.reverse = False
            elif offset < -dead_band:
                self.braked = True
            elif self.braked:
                self.reverse = True

    def target(self, now: float) -> DriveCommand:
        """Speed, m/s, and curvature, 1/m, that the car approaches."""
        s = self.settings
        if now - self.time > SIGNAL_LOST:
            return DriveCommand(0.0, 0.0)
        offset = self.widths["motor"] - s.motor_neutral_us
        speed = max(0.0, abs(offset) - s.motor_dead_band_us) / s.motor_us_per_m_s
        if offset < 0:
            speed = -speed if self.reverse else 0.0
        front = (self.widths["front"] - s.front_neutral_us) / s.front_us_per_1_m
        rear = (self.widths["rear"] - s.rear_neutral_us) / s.rear_us_per_1_m
        return DriveCommand(speed, (front + rear) / 2)
