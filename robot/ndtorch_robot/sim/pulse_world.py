"""A simulated world in real time, whose car does what the pulses of a board say."""

from __future__ import annotations

import time

from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.sim.board import Pulse, SimulatedBoard, constants
from ndtorch_robot.sim.simulation import Simulation

SIGNAL_LOST = 0.1
"""Seconds without pulses after which servos and motor controller of model cars stand still."""


class Electronics:
    """Servos and motor controller: from pulse widths to speed and curvature.

    The motor controller takes pulses below neutral for the brake until it has seen neutral after braking; then they
    are reverse, until the car drives forward again.
    """

    def __init__(self) -> None:
        self.constants = constants()
        self.widths = {"motor": 1500.0, "front": 1500.0, "rear": 1500.0}
        self.braked = self.reverse = False
        self.time = 0.0

    def take(self, pulse: Pulse) -> None:
        """A pulse has come."""
        self.widths[pulse.name] = pulse.width
        self.time = pulse.time
        if pulse.name == "motor":
            offset = pulse.width - self.constants["MOTOR_NEUTRAL_US"]
            if offset > self.constants["MOTOR_DEAD_BAND_US"]:
                self.braked = self.reverse = False
            elif offset < -self.constants["MOTOR_DEAD_BAND_US"]:
                self.braked = True
            elif self.braked:
                self.reverse = True

    def drives(self, now: float) -> DriveCommand:
        """Speed, m/s, and curvature, 1/m, that the car goes for."""
        c = self.constants
        if now - self.time > SIGNAL_LOST:
            return DriveCommand(0.0, 0.0)
        offset = self.widths["motor"] - c["MOTOR_NEUTRAL_US"]
        speed = max(0.0, abs(offset) - c["MOTOR_DEAD_BAND_US"]) / c["MOTOR_US_PER_M_S"]
        if offset < 0:
            speed = -speed if self.reverse else 0.0
        front = (self.widths["front"] - c["FRONT_NEUTRAL_US"]) / c["FRONT_US_PER_1_M"]
        rear = (self.widths["rear"] - c["REAR_NEUTRAL_US"]) / c["REAR_US_PER_1_M"]
        return DriveCommand(speed, (front + rear) / 2)


class PulseWorld:
    """Cameras of `Simulation` in real time; its car does what the board's pulses say, at the times they came.

    Implements `robot.ports.CameraPair`. Pictures are drawn when they are asked for, so the time of a frame is that
    of asking.
    """

    def __init__(self, simulation: Simulation, board: SimulatedBoard) -> None:
        self.simulation, self.board = simulation, board
        self.electronics = Electronics()
        self.start = time.monotonic() - simulation.now()
        self.queue = board.queue()
        self.distance = 0.0

    def read(self) -> StereoFrames:
        """What both cameras see now, or with the next frame that is not lost; late frames have the time they tell."""
        while self.simulation.loses_frame():
            time.sleep(1 / self.simulation.rate)
        now = time.monotonic()
        while self.queue and self.queue[0].time <= now:
            pulse = self.queue.popleft()
            self.advance(pulse.time)
            self.electronics.take(pulse)
        self.advance(now)
        frames = self.simulation.capture()
        return frames._replace(time=now - (self.simulation.now() - frames.time))

    def advance(self, now: float) -> None:
        """Let the world move on."""
        car, before = self.simulation.car, self.simulation.now()
        self.simulation.obey(self.electronics.drives(now))
        self.simulation.wait_until(now - self.start)
        self.distance += abs(car.speed) * (self.simulation.now() - before)

    def close(self) -> None:
        """Give the buffers back."""
        self.simulation.close()
