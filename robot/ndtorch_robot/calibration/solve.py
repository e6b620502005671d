"""From corners of many boards to a calibration, and whether it is good enough to drive with."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from ndtorch.errors import InputError
from ndtorch_robot.calibration.board import Board, Points, View
from ndtorch_robot.calibration.model import Calibration, Lens, Matrix, Quality

LEAST_VIEWS = 10
"""Views below which the figures of merit themselves mean little."""

LIMITS = {
    "left_px": 0.5,
    "right_px": 0.5,
    "pair_px": 0.6,
    "row_px": 0.4,
    "row_95_px": 0.8,
    "focal_percent": 1.0,
    "square_percent": 1.0,
}
"""Largest values of `Quality` that are accepted; see docs/robot/calibration.md for the reasons."""

LEAST_TILT = 25.0
"""Degrees that the two boards of most different direction must lie apart."""

HOPELESS = 10.0
"""The same, below which a focal length of any size fits."""

OUTLIER = 2.0
"""Views with an error of more than this many medians are left out."""

LEAST_COVERED = 35.0
"""Smallest share of the image, in percent, that the boards must have covered."""


@contextmanager
def one_thread() -> Iterator[None]:
    """Threads of OpenCV add in any order; with one of them the same views give the same calibration."""
    import cv2

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def calibrate(views: Sequence[View], board: Board, size: tuple[int, int], focal: float | None = None) -> Calibration:
    """Calibrate.

    Each camera on its own first, then the turn and shift between them with the cameras held: all nine unknowns
    of two cameras at once find worse places on few views.

    Args:
        views: corners of the boards.
        size: width and height of the images.
        focal: focal length of the rectified pair in pixels; the mean of both cameras otherwise.

    Raises:
        InputError: fewer than `LEAST_VIEWS` views, cameras that are swapped or one above the other, or views
            from which nothing can be computed.
    """
    import cv2

    if len(views) < LEAST_VIEWS:
        raise InputError(f"{LEAST_VIEWS} pairs that show the whole board are needed, got {len(views)}")
    try:
        with one_thread():
            views = without_outliers(views, board, size)
            objects = [board.points] * len(views)
            corners = [[view.left for view in views], [view.right for view in views]]
            single = [one_camera(objects, points, size) for points in corners]
            tilt = min(one.tilt for one in single)
            if not tilt > HOPELESS:
                raise InputError(
                    f"nothing can be told from boards that all face the same way (within {tilt:.0f} degrees): "
                    f"tilt the board by 30 degrees this way and that"
                )
            pair, *_, rotation, translation, _, _, _, _, _ = cv2.stereoCalibrateExtended(
                objects,
                corners[0],
                corners[1],
                single[0].lens.matrix,
                single[0].lens.coefficients,
                single[1].lens.matrix,
                single[1].lens.coefficients,
                size,
                np.eye(3),
                np.zeros(3),
                flags=cv2.CALIB_FIX_INTRINSIC,
                criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-9),
            )
    except cv2.error as error:
        raise InputError(f"these views cannot be calibrated: {str(error).splitlines()[-1].strip()}") from None
    lenses = (single[0].lens, single[1].lens)
    shift = np.asarray(translation, np.float64).ravel()
    if not np.isfinite(shift).all() or abs(shift[0]) < 2 * np.hypot(shift[1], shift[2]):
        raise InputError(f"the cameras must sit side by side, but the right one is at {-shift.round(3)} m of the left")
    if shift[0] > 0:
        raise InputError(
            f"left and right are swapped: the right camera is {shift[0]:.3f} m to the left of the left one"
        )
    vector = cv2.Rodrigues(np.asarray(rotation))[0].ravel()
    draft = Calibration(
        width_px=size[0],
        height_px=size[1],
        rotation_rad=tuple(vector.tolist()),
        translation_m=tuple(shift.tolist()),
        focal_px=focal or float(np.mean([(lens.fx_px + lens.fy_px) / 2 for lens in lenses])),
        left=lenses[0],
        right=lenses[1],
        quality=Quality(
            views=len(views),
            left_px=single[0].error,
            right_px=single[1].error,
            pair_px=float(pair),
            row_px=0,
            row_95_px=0,
            focal_percent=max(one.doubt for one in single),
            square_percent=0,
            tilt_deg=tilt,
            covered_percent=min(covered(points, size) for points in corners),
        ),
    )
    return draft.model_copy(update={"quality": draft.quality.model_copy(update=alignment(draft, views, board))})


class Single(NamedTuple):
    """One camera on its own.

    Attributes:
        lens: the model.
        error: reprojection error, pixels.
        doubt: standard deviation of the focal lengths, percent.
        each: error of every view, pixels.
        tilt: largest angle between two boards, degrees.
    """

    lens: Lens
    error: float
    doubt: float
    each: Matrix
    tilt: float


def one_camera(objects: list[Points], corners: Sequence[Points], size: tuple[int, int]) -> Single:
    import cv2

    # k3 is left out: it can hardly be told from k2 at these angles, and bends the corners of the image.
    error, matrix, distortion, turns, _, spread, _, each = cv2.calibrateCameraExtended(
        objects, list(corners), size, np.eye(3), np.zeros(5), flags=cv2.CALIB_FIX_K3
    )
    k = np.zeros(5)
    k[: min(5, distortion.size)] = distortion.ravel()[:5]
    fx, fy = float(matrix[0, 0]), float(matrix[1, 1])
    lens = Lens(fx_px=fx, fy_px=fy, cx_px=float(matrix[0, 2]), cy_px=float(matrix[1, 2]), distortion=tuple(k.tolist()))
    spread = np.asarray(spread).ravel()
    ahead = np.array([cv2.Rodrigues(np.asarray(turn))[0][:, 2] for turn in turns])
    tilt = float(np.degrees(np.arccos(np.clip((ahead @ ahead.T).min(), -1, 1))))
    doubt = float(max(spread[0] / fx, spread[1] / fy) * 100)
    return Single(lens, float(error), doubt, np.asarray(each, np.float64).ravel(), tilt)


def without_outliers(views: Sequence[View], board: Board, size: tuple[int, int]) -> Sequence[View]:
    """The views that either camera's model fits about as well as the others.

    One corner that was found in the wrong place spoils its view and bends the model a little. Views are left
    out while enough of them remain.
    """
    objects = [board.points] * len(views)
    errors = [one_camera(objects, points, size).each for points in zip(*views, strict=True)]
    worst = np.max([error / np.median(error) for error in errors], axis=0)
    good = [view for view, value in zip(views, worst, strict=True) if value <= OUTLIER]
    return good if len(good) >= LEAST_VIEWS else views


def rectified(points: Points, lens: Lens, rotation: Matrix, matrix: Matrix) -> Matrix:
    """Pixels `[n, 2]` of a raw image to those of the rectified one."""
    import cv2

    moved = cv2.undistortPoints(
        points.reshape(-1, 1, 2).astype(np.float64), lens.matrix, lens.coefficients, R=rotation, P=matrix
    )
    return np.asarray(moved, np.float64).reshape(-1, 2)


def alignment(calibration: Calibration, views: Sequence[View], board: Board) -> dict[str, Any]:
    """Figures of the rectified pair: rows of the same corner, and the size of the squares by triangulation."""
    turns, matrix = calibration.rectification(), calibration.camera_matrix()
    rows, squares = [], []
    for view in views:
        left = rectified(view.left, calibration.left, turns[0], matrix)
        right = rectified(view.right, calibration.right, turns[1], matrix)
        rows.append(left[:, 1] - right[:, 1])
        depth = calibration.focal_px * calibration.baseline_m / (left[:, 0] - right[:, 0])
        ahead = np.column_stack((left - matrix[:2, 2], np.full(len(left), calibration.focal_px)))
        places = (ahead * (depth / calibration.focal_px)[:, None]).reshape(board.rows, board.columns, 3)
        # Whole rows and columns: the error of one square is mostly that of its two corners.
        squares.append(np.linalg.norm(places[:, -1] - places[:, 0], axis=-1) / (board.columns - 1))
        squares.append(np.linalg.norm(places[-1] - places[0], axis=-1) / (board.rows - 1))
    difference = np.concatenate(rows)
    return {
        "row_px": float(np.sqrt((difference**2).mean())),
        "row_95_px": float(np.percentile(np.abs(difference), 95)),
        "square_percent": float((np.concatenate(squares).mean() / board.square - 1) * 100),
    }


def covered(points: Sequence[Points], size: tuple[int, int], cells: int = 8) -> float:
    """Percent of the cells of an 8 x 8 grid over the image in which a corner was seen."""
    places = np.concatenate(list(points))
    seen = np.zeros((cells, cells), bool)
    column = np.clip((places[:, 0] * cells / size[0]).astype(int), 0, cells - 1)
    row = np.clip((places[:, 1] * cells / size[1]).astype(int), 0, cells - 1)
    seen[row, column] = True
    return float(seen.mean() * 100)


def faults(quality: Quality) -> list[str]:
    """What is not good enough, in words; nothing for a calibration that may be used."""
    words = {
        "left_px": "the left camera's model misses its corners by {} px",
        "right_px": "the right camera's model misses its corners by {} px",
        "pair_px": "both cameras together miss the corners by {} px",
        "row_px": "the rows of the rectified images differ by {} px",
        "row_95_px": "5 % of the rows of the rectified images differ by more than {} px",
        "focal_percent": "the focal length is known to {} % only: tilt the board more",
        "square_percent": "squares are measured {} % wrong: is --square-mm right, and the board flat?",
    }
    found = [
        words[name].format(f"{getattr(quality, name):.2f}") + f" ({limit:g} are allowed)"
        for name, limit in LIMITS.items()
        if not abs(getattr(quality, name)) <= limit
    ]
    if quality.tilt_deg < LEAST_TILT:
        found.append(f"the boards lie within {quality.tilt_deg:.0f} degrees, {LEAST_TILT:g} are needed: tilt them more")
    if quality.covered_percent < LEAST_COVERED:
        found.append(f"the boards covered {quality.covered_percent:.0f} % of the image, {LEAST_COVERED:g} % are needed")
    return found
