"""Drive links of a Raspberry Pi. Its board is a process that speaks the firmware's protocol:

    python -m ndtorch_robot.link.pi_board KIND NAME SETTINGS

opens a terminal (pty), prints its path, and moves servos and motor as `Board` says. The wheels are neutral before the
first command, 150 ms after the last one, and at the end of this process or of the one that started it.
"""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
import tty

from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.utils.packages import need
from ndtorch_robot.link import Opening, link
from ndtorch_robot.link.board import NAMES, TICK_MS, Board, BoardSettings
from ndtorch_robot.link.serial_drive import SerialDrive

MODE1, PRESCALE, LED0, LED_BYTES = 0x00, 0xFE, 0x06, 4
"""Registers of the PCA9685; each of 16 channels has four: the counts at which its pulse begins and ends."""

SLEEP, AUTO_INCREMENT, RESTART = 0x10, 0x20, 0x80
CLOCK_HZ, COUNTS, WAKE_S = 25e6, 4096, 0.0005
"""Bits of MODE1, clock of the PCA9685, counts of one period, and seconds until its clock runs."""


class PiSettings(BoardSettings):
    """`[link]` of both links of a Raspberry Pi: the car as for the firmware, with a shorter wait for commands."""

    command_timeout_ms: int = Field(150, gt=0, le=150)
    heartbeat_timeout_ms: int = Field(150, gt=0, le=150)


class Pca9685Settings(PiSettings):
    """`[link]` with `kind = "pca9685"`: bus, address and clock of the board, and its channels; rear -1 is none."""

    bus: int = Field(1, ge=0)
    address: int = Field(0x40, ge=0x03, le=0x77)
    rate_hz: float = Field(50.0, ge=40, le=200)
    motor: int = Field(0, ge=0, le=15)
    front: int = Field(1, ge=0, le=15)
    rear: int = Field(-1, ge=-1, le=15)


class GpioSettings(PiSettings):
    """`[link]` with `kind = "gpio"`: BCM numbers of the pins of the front servo and of a motor driver (H-bridge)."""

    servo: int = Field(12, ge=0, le=27)
    forward: int = Field(23, ge=0, le=27)
    backward: int = Field(24, ge=0, le=27)
    enable: int = Field(18, ge=-1, le=27)


class Pca9685:
    """Pulses by a PCA9685. It goes on with its last pulses when nobody writes, so neutral is written at the end."""

    brakes_first = True  # the motor controller brakes before it reverses

    def __init__(self, settings: Pca9685Settings) -> None:
        self.settings, self.shown = settings, dict[int, int]()
        prescale = round(CLOCK_HZ / (COUNTS * settings.rate_hz)) - 1
        self.count_s = (prescale + 1) / CLOCK_HZ
        self.bus = need("smbus2", "a PCA9685").SMBus(settings.bus)
        self.write(MODE1, SLEEP | AUTO_INCREMENT)  # the prescaler can be set in sleep alone, in which no pulses come
        self.write(PRESCALE, prescale)
        self.show(Board("", settings))
        self.write(MODE1, AUTO_INCREMENT)
        time.sleep(WAKE_S)
        self.write(MODE1, AUTO_INCREMENT | RESTART)

    def write(self, register: int, value: int) -> None:
        self.bus.write_byte_data(self.settings.address, register, value)

    def show(self, board: Board) -> None:
        for name, width in zip(NAMES, board.widths, strict=True):
            channel, count = getattr(self.settings, name), round(width * 1e-6 / self.count_s)
            if channel >= 0 and self.shown.get(channel) != count:
                begin_and_end = [0, 0, count & 0xFF, count >> 8]
                self.bus.write_i2c_block_data(self.settings.address, LED0 + LED_BYTES * channel, begin_and_end)
                self.shown[channel] = count

    def close(self) -> None:
        self.bus.close()


class Gpio:
    """A servo and a motor driver at pins of the Pi, by gpiozero; without this process there are no pulses."""

    brakes_first = False

    def __init__(self, settings: GpioSettings) -> None:
        gpiozero = need("gpiozero", "pins of a Raspberry Pi")
        self.settings = s = settings
        self.middle, self.half = (s.max_pulse_us + s.min_pulse_us) / 2, (s.max_pulse_us - s.min_pulse_us) / 2
        self.motor = gpiozero.Motor(s.forward, s.backward, enable=s.enable if s.enable >= 0 else None)
        widths = {"min_pulse_width": s.min_pulse_us / 1e6, "max_pulse_width": s.max_pulse_us / 1e6}
        self.servo = gpiozero.Servo(s.servo, initial_value=self.servo_value(s.front_neutral_us), **widths)

    def servo_value(self, width: float) -> float:
        return (width - self.middle) / self.half

    def show(self, board: Board) -> None:
        values = board.speed / self.settings.max_speed_mm_s, self.servo_value(board.widths[1])
        for device, value in zip((self.motor, self.servo), values, strict=True):
            if device.value != value:
                device.value = value

    def close(self) -> None:
        self.motor.close()
        self.servo.close()


def serve(kind: str, name: str, settings: str) -> None:
    """Be the board until the input ends, which it does with the process at its other end, or SIGTERM comes."""
    values = json.loads(settings)
    pins = Pca9685(Pca9685Settings(**values)) if kind == "pca9685" else Gpio(GpioSettings(**values))
    board = Board(name, pins.settings, pins.brakes_first)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    master, slave = pty.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    try:
        print(os.ttyname(slave), flush=True)
        start = time.monotonic()
        while sys.stdin not in (ready := select.select([master, sys.stdin], [], [], TICK_MS / 1e3)[0]):
            answers = board.run(time.monotonic() - start, os.read(master, 4096) if ready else b"")
            pins.show(board)
            with contextlib.suppress(BlockingIOError):  # nobody reads
                os.write(master, answers)
    finally:
        board.stand()
        pins.show(board)
        pins.close()


PROGRAM = (sys.executable, "-m", "ndtorch_robot.link.pi_board")


class PiDrive(SerialDrive):
    """A drive whose board is the process of `serve`, at the other end of a terminal.

    It has a session of its own; a thread would stop with the program. Nothing watches it in turn.

    Raises:
        InputError: the process does not start: no such bus or pin, or a library is missing.
    """

    def __init__(self, kind: str, settings: PiSettings, opening: Opening) -> None:
        command = [*PROGRAM, kind, opening.board_name, settings.model_dump_json()]
        pipe = subprocess.PIPE
        self.board = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, start_new_session=True)
        assert self.board.stdout is not None
        device = self.board.stdout.readline().strip()
        if not device:
            why = (self.board.communicate()[1].strip().splitlines() or ["no reason given"])[-1]
            raise InputError(f"link.kind = {kind!r}: its board does not start: {why}")
        super().__init__(device, board_name=opening.board_name, report=opening.report)

    def close(self) -> None:
        super().close()
        if self.board.poll() is None:
            self.board.communicate(timeout=2.0)  # ends its input


@link("pca9685")
def open_pca9685(settings: Pca9685Settings, opening: Opening) -> PiDrive:
    return PiDrive("pca9685", settings, opening)


@link("gpio")
def open_gpio(settings: GpioSettings, opening: Opening) -> PiDrive:
    return PiDrive("gpio", settings, opening)


if __name__ == "__main__":
    serve(*sys.argv[1:])
