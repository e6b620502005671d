"""Maps as files: `map.npz`, which this package reads again, and `map.pgm` with `map.yaml`, which ROS reads."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.arguments import as_path, check_dense, check_state
from ndtorch.errors import InputError
from ndtorch.navigation.mapping.grid_map import Grid
from ndtorch.utils.files import load_arrays, replacing, save_arrays, write_text

Floats = npt.NDArray[np.float64]
Cells = npt.NDArray[np.float32]

FAINTEST = 0.02  # a cell is occupied from this share of the largest on

PIXEL = 5
"""Cells along the side of a pixel of the picture for ROS: 5 cm with cells of 1 cm, as planners there use."""

PASSED = 0.18  # metres to either side of the path that are free because the body was there: half its width

OCCUPIED, UNKNOWN, FREE = 0, 205, 254
"""Gray levels that `map_server` of ROS reads as occupied, unknown and free."""

YAML = """image: map.pgm
mode: trinary
resolution: {resolution:g}
origin: [{left:.6g}, {bottom:.6g}, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


class SavedMap(NamedTuple):
    """A map from a file."""

    cells: Tensor  # `[rows, columns]`, the largest is 1; row 0 is at the smallest y
    grid: Grid  # where the cells are
    # sparse NDT cells, `[k, 8]`, see `ndtorch.navigation.localisation.ndt`; None in a map that was made
    # without `localise`. The file calls them `walls`
    ndt_cells: Cells | None


def save_map(
    folder: str | Path,
    cells: Tensor,
    grid: Grid,
    path: Floats,
    ndt_cells: Cells | None = None,
    **more: npt.NDArray[Any],
) -> None:
    """Write `map.npz`, `map.pgm` and `map.yaml` into a folder.

    Args:
        cells: `[rows, columns]` of the grid.
        path: places where the car was, `[T, 2]` or more columns, in the frame of the map.
        ndt_cells: see `SavedMap`.
        more: further arrays for `map.npz`.

    Raises:
        InputError: cells of another shape than the grid has.
    """
    folder = as_path("folder", folder)
    check_dense("cells", cells)
    check_state(grid, Grid, "grid")
    if tuple(cells.shape) != (grid.rows, grid.columns):
        raise InputError(f"expected cells [{grid.rows}, {grid.columns}], got {tuple(cells.shape)}")
    arrays = {"cells": cells.numpy(), "bounds": np.array([grid.left, grid.right, grid.bottom, grid.top])}
    walls = {} if ndt_cells is None else {"walls": ndt_cells}
    save_arrays(folder / "map.npz", {**arrays, "cell": np.array(grid.cell), **walls, **more})
    pixels = ros_pixels(cells, grid, path)
    with replacing(folder / "map.pgm") as beside:
        rows, columns = pixels.shape
        # Pictures begin at the top, which is the largest y.
        beside.write_bytes(f"P5\n{columns} {rows}\n255\n".encode() + np.ascontiguousarray(pixels[::-1]).tobytes())
    write_text(folder / "map.yaml", YAML.format(resolution=grid.cell * PIXEL, left=grid.left, bottom=grid.bottom))


def ros_pixels(cells: Tensor, grid: Grid, path: Floats) -> npt.NDArray[np.uint8]:
    """Gray levels `[rows, columns]` of pixels of `PIXEL` cells, row 0 at the smallest y.

    A pixel is occupied where a cell of it is, free where the car's body was, and unknown elsewhere.
    """
    import cv2

    rows, columns, side = -(-grid.rows // PIXEL), -(-grid.columns // PIXEL), grid.cell * PIXEL
    largest = np.pad(cells.numpy(), ((0, rows * PIXEL - grid.rows), (0, columns * PIXEL - grid.columns)))
    largest = largest.reshape(rows, PIXEL, columns, PIXEL).max((1, 3))
    passed = np.zeros((rows, columns), np.uint8)
    column, row = np.floor((path[:, :2] - (grid.left, grid.bottom)) / side).astype(np.int64).T
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    passed[row[inside], column[inside]] = 1
    reach = int(PASSED / side)
    disc = np.hypot(*np.indices((2 * reach + 1, 2 * reach + 1)) - reach) <= reach
    pixels = np.where(cv2.dilate(passed, disc.astype(np.uint8)) > 0, np.uint8(FREE), np.uint8(UNKNOWN))
    if largest.max(initial=0.0) > 0:
        pixels[largest >= FAINTEST * largest.max()] = OCCUPIED
    return pixels


def load_map(file: str | Path) -> SavedMap:
    """Read a `map.npz`, or the one in a folder.

    Raises:
        InputError: there is none, it is damaged, or it is no map.
    """
    file = as_path("file", file)
    file = file / "map.npz" if os.path.isdir(file) else file  # noqa: PTH112 - `Path` raises for names too long
    found = load_arrays(file)
    try:
        cells, bounds, cell = found["cells"], found["bounds"], float(found["cell"])
        walls = found.get("walls")
        left, right, bottom, top = map(float, bounds)
        grid = Grid(left, right, bottom, top, cell)
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{file} cannot be read as a map: {error}") from None
    if cells.dtype.kind != "f":
        raise InputError(f"{file} is no map: cells must be of floating point, got {cells.dtype}")
    if cells.shape != (grid.rows, grid.columns) or not np.isfinite(cells).all():
        raise InputError(f"{file} is no map: cells of shape {cells.shape} for a grid of {grid.rows} x {grid.columns}")
    if walls is not None and (walls.ndim != 2 or walls.shape[1] != 8 or not np.isfinite(walls).all()):
        raise InputError(f"{file} is no map: walls must be [k, 8] and finite, got {walls.shape}")
    return SavedMap(torch.from_numpy(cells), grid, None if walls is None else walls.astype(np.float32))
