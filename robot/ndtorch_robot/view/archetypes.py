"""Archetypes of rerun for what a view shows: frames, features, the car, its path and the map."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.navigation import Grid, Navigator, Rect, StereoRig, Strips
from ndtorch_robot.evaluation.record import range_columns

TIMELINE = "time"

FRAMES_PER_SECOND = 10
"""Pairs of frames a second: enough to look at, at a third of the size."""

JPEG_QUALITY = 75

FAINT = 0.04
"""Cells of the map are shown from this share of the largest on."""

CELLS = 20_000
"""Cells of the map shown at most, the strongest ones."""

LEFT, RIGHT, OTHER, FEATURE, PATH, BELIEVED, CAR = (
    (0, 114, 178),
    (213, 94, 0),
    (90, 90, 90),
    (240, 228, 66),
    (0, 114, 178),
    (204, 121, 167),
    (0, 158, 115),
)
MAP_LOW, MAP_HIGH = np.array([250.0, 190.0, 120.0]), np.array([170.0, 20.0, 20.0])
WHITE = (255, 255, 255)
SPEEDS = ("left", "right", "difference")
SPEED_COLORS = [LEFT, RIGHT, (230, 159, 0)]

UNREAD = 40
"""Grey of what is not in the strips."""

THICK = 4
"""A row that is read alone is drawn with so many more rows above and below, to be seen at all."""


def thresholds(navigator: Navigator) -> dict[str, float]:
    """Lines to draw beside the speeds: the controller's thresholds, by name."""
    lines: dict[str, float] = navigator.controller.trace.lines()
    return lines


def field_box(rr: Any, field: Rect, side: str) -> Any:
    return rr.Boxes2D(
        mins=[(field.left, field.top)],
        sizes=[(field.right - field.left, field.bottom - field.top)],
        colors=[LEFT if side == "left" else RIGHT],
        labels=["read"],
        show_labels=False,
    )


def speed_lines(rr: Any, lines: dict[str, float]) -> Any:
    widths = [1.5, 1.5, 2.0] + [0.8] * len(lines)
    return rr.SeriesLines(colors=SPEED_COLORS + [OTHER] * len(lines), names=[*SPEEDS, *lines], widths=widths)


def feature_points(rr: Any, ranges: npt.NDArray[np.float32], rig: StereoRig) -> tuple[Any, Any]:
    """Ranged features `[4, n]` in the left and the right image."""
    both = []
    for column in range_columns(ranges[None], rig, linear=False):
        seen = column[0][~np.isnan(column[0])]
        points = np.stack((seen + 0.5, np.full(len(seen), rig.row + 0.5)), -1)
        both.append(rr.Points2D(points, colors=[FEATURE], radii=5.0))
    return both[0], both[1]


def frame_image(frame: Tensor | Strips, field: Rect, rig: StereoRig) -> npt.NDArray[np.uint8]:
    """A frame `[1, C, H, W]` as `[H, W, 3]` uint8, or strips in their places, where the row is drawn thicker."""
    if isinstance(frame, Tensor):
        return pixels(frame)
    whole = np.full((rig.height, rig.width, 3), UNREAD, np.uint8)
    row = pixels(frame.row)
    top, bottom = max(0, rig.row - THICK), min(rig.height, rig.row + THICK + 1)
    whole[top:bottom] = row
    whole[field.top : field.bottom, field.left : field.right] = pixels(frame.field)
    return whole


def pixels(frame: Tensor) -> npt.NDArray[np.uint8]:
    bytes_ = frame if frame.dtype == torch.uint8 else (frame.clamp(0, 1) * 255).round().byte()
    return bytes_[0].permute(1, 2, 0).numpy()


def jpeg(rr: Any, image: npt.NDArray[np.uint8]) -> Any:
    import cv2

    turned = np.ascontiguousarray(image[..., ::-1])
    _, data = cv2.imencode(".jpg", turned, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return rr.EncodedImage(contents=data.tobytes(), media_type="image/jpeg")


def car_arrow(rr: Any, pose: tuple[float, float, float]) -> Any:
    x, y, heading = pose
    vector = (0.45 * math.cos(heading), -0.45 * math.sin(heading))
    return rr.Arrows2D(origins=[(x, -y)], vectors=[vector], colors=[CAR], radii=0.06)


def map_points(rr: Any, grid: Grid, cells: Tensor, radius: float) -> Any:
    """The strongest cells of a map, with its margin, as points of a radius in m, or minus that in screen points."""
    inner = grid.inner(cells)
    largest = inner.max().clamp_min(1e-9)
    row, column = (inner > FAINT * largest).nonzero(as_tuple=True)
    value = inner[row, column]
    if len(value) > CELLS:
        value, strongest = value.topk(CELLS)
        row, column = row[strongest], column[strongest]
    share = (value / largest).clamp(0, 1).sqrt().numpy()[:, None]
    x, y = grid.center(row, column)
    points = np.stack((x.numpy(), -y.numpy()), -1)
    colors = (MAP_LOW + share * (MAP_HIGH - MAP_LOW)).astype(np.uint8)
    return rr.Points2D(points, colors=colors, radii=radius)


def flipped(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Points as the viewer draws them, whose y axis points down."""
    return points * (1.0, -1.0)


def panels() -> list[Any]:
    """The viewer's own panels, collapsed; it follows the newest time."""
    import rerun.blueprint as rrb

    return [
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
    ]
