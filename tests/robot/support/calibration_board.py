"""Pictures of boards by a pair of cameras that a clumsy hand has put together."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from ndtorch_robot.calibration import Board, calibrate, find_view


def turn(rx, ry, rz):
    """Rotation matrix of turns about x (right), y (down) and z (ahead), degrees, z first."""
    x, y, z = (cv2.Rodrigues(np.radians(angle) * axis)[0] for angle, axis in zip((rx, ry, rz), np.eye(3), strict=True))
    return x @ y @ z


@dataclass
class Eye:
    """A camera: focal lengths, axis, distortion k1 k2 p1 p2; `rotation`, `place`: of the camera in the world."""

    fx: float = 430.0
    fy: float = 430.0
    cx: float = 319.5
    cy: float = 239.5
    k: tuple = (0.0, 0.0, 0.0, 0.0)
    rotation: np.ndarray = None
    place: tuple = (0.0, 0.0, 0.0)
    width: int = 640
    height: int = 480

    def __post_init__(self):
        self.rotation = np.eye(3) if self.rotation is None else self.rotation
        self.matrix = np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]])

    def rays(self):
        """Directions `[h, w, 3]` in the world of the pixels."""
        pixels = np.mgrid[: self.height, : self.width][::-1].reshape(2, -1).T.astype(float)
        straight = cv2.undistortPoints(pixels, self.matrix, np.array(self.k), criteria=(3, 50, 1e-12))
        return np.pad(straight.reshape(self.height, self.width, 2), ((0, 0), (0, 0), (0, 1)), constant_values=1) @ (
            self.rotation.T
        )

    def project(self, points):
        """World points `[n, 3]` to pixels `[n, 2]`."""
        local = (np.asarray(points) - self.place) @ self.rotation
        return cv2.projectPoints(local, np.zeros(3), np.zeros(3), self.matrix, np.array(self.k))[0].reshape(-1, 2)


def wave(u):
    """A square wave of period 2, +1 for u in 0..1, averaged over the width of a pixel."""
    down, across = np.gradient(u)
    half = (np.abs(across) + np.abs(down)) / 2

    def integral(value):  # of the wave from 0: a triangle
        return 1 - np.abs(np.mod(value, 2) - 1)

    return (integral(u + half) - integral(u - half)) / (2 * half)


def draw_board(eye, rays, rotation, origin, columns, rows, square):
    """A grey picture of a board whose first inner corner is at `origin`, x along its columns."""
    local = rays @ rotation
    start = (np.asarray(eye.place) - origin) @ rotation
    distance = -start[2] / local[..., 2]
    u = (start[0] + distance * local[..., 0]) / square
    v = (start[1] + distance * local[..., 1]) / square
    on = (u > -1) & (u < columns) & (v > -1) & (v < rows) & (distance > 0)
    light = np.where(on, 125 - 95 * wave(u) * wave(v), 220.0)  # the paper's rim is light, as is the wall behind
    return light.round().astype(np.uint8)


def poses(count, columns, rows, square, seed=0):
    """Boards all over the picture, tilted this way and that: rotation and place of the first corner."""
    rng = np.random.default_rng(seed)
    found = []
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2, 0.0]) * square
    for n in range(count):
        rotation = turn(*rng.uniform(-35, 35, 2), rng.uniform(-15, 15))
        distance = rng.uniform(0.65, 1.2)
        across = (n % 4 - 1.5) / 1.5 * 0.28 + rng.uniform(-0.04, 0.04)
        down = (n // 4 % 3 - 1) * 0.27 + rng.uniform(-0.04, 0.04)
        center = np.array([across * distance + 0.15, down * distance, distance])
        found.append((rotation, center - rotation @ middle))
    return found


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
    """The pair calibrated from its pictures, as a user would, and its quality."""
    return calibrate(views(), BOARD, (640, 480))
