"""A pair of cameras that a clumsy hand has put together, its boards, and what it sees in the simulated building."""

from functools import cache

from ndtorch_robot.calibration import Board, calibrate, find_view
from tests.robot.support.board_renderer import Eye, draw_board, poses, turn

BOARD = Board(9, 6, 0.04)
LEFT = Eye(425.0, 427.0, 322.5, 236.8, (-0.12, 0.05, 0.0007, -0.0004))
RIGHT = Eye(433.0, 434.0, 315.1, 243.9, (-0.10, 0.03, -0.0005, 0.0006), turn(0.8, 0.7, 1.0), (0.301, 0.002, -0.003))
"""The right one looks 0.7° aside and 0.8° up, rolls by 1°, and sits 2 mm low and 3 mm behind."""


@cache
def rays():
    return LEFT.rays(), RIGHT.rays()


@cache
def board_pictures(count=16, seed=0):
    """Pairs of grey pictures of boards, and where their corners truly are."""
    found = []
    for rotation, origin in poses(count, BOARD.columns, BOARD.rows, BOARD.square, seed):
        eyes = zip((LEFT, RIGHT), rays(), strict=True)
        pair = [draw_board(eye, ray, rotation, origin, 9, 6, BOARD.square) for eye, ray in eyes]
        found.append((pair[0], pair[1], origin + BOARD.points.astype(float) @ rotation.T))
    return found


@cache
def views():
    """What is seen of them."""
    found = (find_view(left, right, BOARD) for left, right, _ in board_pictures())
    return [view for view in found if view is not None]


@cache
def measured():
    """The pair calibrated from its pictures, as a user would."""
    return calibrate(views(), BOARD, (640, 480))
