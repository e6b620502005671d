"""Links to a simulated car: through the board in Python, through the firmware's own code, or to the car itself."""

from __future__ import annotations

import time
from collections.abc import Callable

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict
from ndtorch_robot.link import HOSTED_BOARD, SIMULATED_BOARD, SIMULATED_WORLD, Opening, link
from ndtorch_robot.link.board import NAMES, PERIOD_MS, Board, Pulse
from ndtorch_robot.link.link_drive import HEARTBEAT, LinkDrive
from ndtorch_robot.ports import CameraPair, Clock, StereoFrames
from ndtorch_robot.sim.firmware_host import Electronics, FirmwareHost
from ndtorch_robot.sim.simulation import SUBSTEPS, Simulation

Cable = Callable[[bytes, float], bytes]
"""What comes out at the other end now, s, when these bytes were put in."""

ANSWERS_IN = 1.0
"""Seconds in which the board must answer."""


class SimulatedDrive(LinkDrive):
    """A link that has its board, the world with the cameras, and the clock with it. It needs no hardware.

    In every step of simulated time the board runs, its pulses move the car, and the link reads the board's answers and
    sends its heartbeats. Implements `ports.CameraPair`, `ports.Clock` and the port of the link, too.

    `up` and `down` are what the cable does to bytes from the computer to the board and back; `pulsed` is
    called with every pulse. Raises `InputError` where the board does not answer, or is that of another car.
    """

    def __init__(self, board: Board | FirmwareHost, opening: Opening, real_time: bool = False) -> None:
        self.simulation, self.board, self.electronics = opening.world, board, Electronics()
        self.up: Cable = lambda data, now: data
        self.down: Cable = lambda data, now: data
        self.pulsed: Callable[[Pulse], None] = lambda pulse: None
        self.waiting, self.beaten, self.period = b"", 0.0, 0
        self.start = time.monotonic() - self.simulation.now() if real_time else None
        super().__init__(self, self.simulation.now, opening.board_name, opening.report)
        while not self.welcomed.is_set():
            if self.refusal is not None or self.now() > ANSWERS_IN:
                self.close()
                raise InputError(self.refusal or "the board does not answer")
            self.wait_until(self.now() + 1 / SUBSTEPS)

    def wait_until(self, time_: float) -> None:
        while self.simulation.steps < round(time_ * SUBSTEPS):
            now = (self.simulation.steps + 1) / SUBSTEPS
            sent, self.waiting = self.waiting, b""
            answers = self.board.run(now, self.up(sent, now))
            before, self.period = self.period, round(now * 1e3) // PERIOD_MS
            for name, width in zip(NAMES, self.board.widths, strict=True) if self.period > before else ():
                pulse = Pulse(name, width, now)
                self.electronics.apply(pulse)
                self.pulsed(pulse)
            self.simulation.obey(self.electronics.target(now))
            self.simulation.wait_until(now)
            self.handle(self.down(answers, now))
            self.greet()
            if now - self.beaten >= HEARTBEAT:
                self.beaten = now
                self.look_after()
        if self.start is not None:
            time.sleep(max(0.0, self.start + time_ - time.monotonic()))

    def write(self, data: bytes, /) -> None:
        self.waiting += data

    def read(self) -> StereoFrames:
        """As `Simulation.read`; board and link go on meanwhile."""
        return self.simulation.read(self.wait_until)

    def cameras_and_clock(self) -> tuple[CameraPair, Clock]:
        return self, self

    def close(self) -> None:
        super().close()
        self.board.close()


class SimulatedSettings(Strict):
    """`[link]` with kind `"simulated-board"`, in Python, or `"hosted-board"`, the firmware compiled by `cc`."""

    real_time: bool = False  # simulated time does not run ahead of real time


@link(HOSTED_BOARD)
def open_hosted(settings: SimulatedSettings, opening: Opening) -> SimulatedDrive:
    return SimulatedDrive(FirmwareHost(), opening, settings.real_time)


@link(SIMULATED_BOARD)
def open_simulated(settings: SimulatedSettings, opening: Opening) -> SimulatedDrive:
    return SimulatedDrive(Board(opening.board_name), opening, settings.real_time)


@link(SIMULATED_WORLD)
def open_world(settings: Strict, opening: Opening) -> Simulation:
    return opening.world
