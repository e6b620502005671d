"""Two cameras measured with a chessboard, and their images made parallel."""

from ndtorch_robot.calibration.board import Board, View, find_corners, find_view, find_views, folder_pairs
from ndtorch_robot.calibration.model import Calibration, Lens, Quality, read_calibration, write_calibration
from ndtorch_robot.calibration.rectify import Rectifier
from ndtorch_robot.calibration.solve import LIMITS, calibrate, faults

__all__ = [
    "LIMITS",
    "Board",
    "Calibration",
    "Lens",
    "Quality",
    "Rectifier",
    "View",
    "calibrate",
    "faults",
    "find_corners",
    "find_view",
    "find_views",
    "folder_pairs",
    "read_calibration",
    "write_calibration",
]
