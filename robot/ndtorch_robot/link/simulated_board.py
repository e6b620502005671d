"""The serial link to the firmware on a simulated processor, whose pulses move the simulated car."""

from __future__ import annotations

from pathlib import Path

from ndtorch.errors import InputError
from ndtorch.toml import Strict
from ndtorch_robot.link.registry import SIMULATED_BOARD, Opening, link
from ndtorch_robot.link.serial_drive import SerialDrive
from ndtorch_robot.loop import MonotonicClock
from ndtorch_robot.ports import CameraPair, Clock, Report
from ndtorch_robot.sim.board import SimulatedBoard
from ndtorch_robot.sim.pulse_world import PulseWorld
from ndtorch_robot.sim.simulation import Simulation


class BoardSettings(Strict):
    """`[link]` with `kind = "simulated-board"`.

    Args:
        pulse_log: file for every pulse that the board makes.
    """

    pulse_log: Path | None = None


class BoardDrive(SerialDrive):
    """A `SerialDrive` that has its board with it."""

    def __init__(self, board: SimulatedBoard, robot: str, report: Report, simulation: Simulation | None) -> None:
        self.board, self.simulation = board, simulation
        super().__init__(board.device, robot=robot, report=report)

    def sight(self) -> tuple[CameraPair, Clock]:
        """Pictures of the world that the pulses move, in real time."""
        if self.simulation is None:
            raise InputError("this simulated board was opened without a world")
        return PulseWorld(self.simulation, self.board), MonotonicClock()

    def close(self) -> None:
        """Stop, and end the simulated processor."""
        super().close()
        self.board.close()


@link(SIMULATED_BOARD, BoardSettings)
def open_board(settings: BoardSettings, opening: Opening) -> BoardDrive:
    """Start the firmware and connect to it."""
    board = SimulatedBoard(settings.pulse_log)
    try:
        return BoardDrive(board, opening.robot, opening.report, opening.simulation)
    except BaseException:
        board.close()
        raise
