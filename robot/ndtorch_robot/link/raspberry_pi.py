"""Drive links of a Raspberry Pi: servos and motor at its I2C bus or its pins, behind a watchdog process."""

from __future__ import annotations

import subprocess
import sys

from ndtorch.errors import InputError
from ndtorch_robot.link import Opening, link
from ndtorch_robot.link.pi_board import GpioSettings, Pca9685Settings, PiSettings
from ndtorch_robot.link.serial_drive import SerialDrive

PROGRAM = (sys.executable, "-m", "ndtorch_robot.link.pi_board")


class PiDrive(SerialDrive):
    """A drive whose board is the process of `pi_board`, at the other end of a terminal.

    It is a process, in a session of its own, because a thread would stop with the program. Nothing watches it in turn.

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
