"""A simulated world, its firmware and the line between them on one simulated time, step by step."""

from __future__ import annotations

import time
from collections.abc import Callable

from ndtorch.errors import InputError
from ndtorch_robot.link.link_drive import HEARTBEAT, LinkDrive
from ndtorch_robot.ports import StereoFrames
from ndtorch_robot.sim.firmware_host import Electronics, FirmwareHost, Pulse
from ndtorch_robot.sim.simulation import SUBSTEPS, Simulation

Cable = Callable[[bytes, float], bytes]
"""What comes out at the other end now, s, when these bytes were put in."""

ANSWERS_IN = 1.0
"""Seconds in which the board must answer."""


def good_cable(data: bytes, now: float) -> bytes:
    return data


class SteppedWorld:
    """Cameras, clock, board and the drive link of a simulated car, on one simulated time.

    In every step of time the board runs, its pulses move the car, and the link reads the board's answers and sends its
    heartbeats. Implements `ports.CameraPair` and `ports.Clock`.

    Args:
        drive: the link, which writes into this world.
        real_time: simulated time does not run ahead of real time.

    Attributes:
        up, down: what the cable does to bytes from the computer to the board, and back.
        pulsed: called with every pulse.
        distance: driven so far, m.

    Raises:
        InputError: no C compiler.
    """

    def __init__(self, simulation: Simulation, drive: LinkDrive, real_time: bool = False) -> None:
        self.drive, self.simulation, self.board, self.electronics = drive, simulation, FirmwareHost(), Electronics()
        self.up: Cable = good_cable
        self.down: Cable = good_cable
        self.pulsed: Callable[[Pulse], None] = lambda pulse: None
        self.waiting = bytearray()
        self.beaten = self.distance = 0.0
        self.start = time.monotonic() - simulation.now() if real_time else None

    def await_welcome(self) -> None:
        """Let time go on until the board has answered. Raises `InputError`: it does not, or is that of another car."""
        while not self.drive.welcomed.is_set():
            if self.drive.refusal is not None or self.now() > ANSWERS_IN:
                self.board.close()
                raise InputError(self.drive.refusal or "the board does not answer")
            self.wait_until(self.now() + 1 / SUBSTEPS)

    def now(self) -> float:
        return self.simulation.now()

    def wait_until(self, time_: float) -> None:
        while self.simulation.steps < round(time_ * SUBSTEPS):
            now = (self.simulation.steps + 1) / SUBSTEPS
            sent, self.waiting = bytes(self.waiting), bytearray()
            answers, pulses = self.board.run(now, self.up(sent, now))
            for pulse in pulses:
                self.electronics.apply(pulse)
                self.pulsed(pulse)
            self.simulation.obey(self.electronics.target(now))
            self.simulation.wait_until(now)
            self.distance += abs(self.simulation.car.speed) / SUBSTEPS
            self.drive.handle(self.down(answers, now))
            self.drive.greet()
            if now - self.beaten >= HEARTBEAT:
                self.beaten = now
                self.drive.look_after()
        if self.start is not None:
            time.sleep(max(0.0, self.start + time_ - time.monotonic()))

    def write(self, data: bytes, /) -> None:
        """The computer puts bytes on the line: it is the port of the link."""
        self.waiting += data

    def read(self) -> StereoFrames:
        """What both cameras see now, or with the next frame that is not lost. Board and link go on meanwhile."""
        while self.simulation.loses_frame():
            self.wait_until(self.now() + 1 / self.simulation.rate)
        return self.simulation.capture()

    def restart_board(self) -> None:
        """Its power goes and comes again: it knows nothing any more."""
        self.board.reset(self.now())

    def close(self) -> None:
        self.board.close()
