"""Maps as files: what is written is read again, and ROS finds every wall where it is."""

import numpy as np
import torch

from ndtorch.navigation import Grid
from ndtorch.navigation.mapping.map_files import FREE, OCCUPIED, UNKNOWN, load_map, save_map

GRID = Grid(-1.0, 2.0, -0.5, 1.53, 0.01)


def write(folder, **more):
    cells = torch.zeros(GRID.rows, GRID.columns)
    row, column = GRID.find(torch.tensor(1.22), torch.tensor(0.92))
    cells[row - 1, column - 1] = 1.0
    path = np.stack((np.linspace(-0.8, 0.4, 50), np.full(50, -0.2)), -1)
    save_map(folder, cells, GRID, path, **more)
    return cells


def test_a_map_is_read_again_as_it_was(tmp_path):
    ndt_cells = np.arange(16, dtype=np.float32).reshape(2, 8)
    cells = write(tmp_path, ndt_cells=ndt_cells, true_path=np.zeros((3, 3)))
    for place in (tmp_path, tmp_path / "map.npz"):
        read = load_map(place)
        assert read.grid == GRID
        assert torch.equal(read.cells, cells)
        assert np.array_equal(read.ndt_cells, ndt_cells)
    write(tmp_path)
    assert load_map(tmp_path).ndt_cells is None


def test_ros_finds_walls_free_floor_and_the_unknown_where_they_are(tmp_path):
    write(tmp_path)
    header, size, most, pixels = (tmp_path / "map.pgm").read_bytes().split(b"\n", 3)
    columns, rows = map(int, size.split())
    assert (header, most, columns, rows) == (b"P5", b"255", 60, 41)
    image = np.frombuffer(pixels, np.uint8).reshape(rows, columns)
    said = dict(line.split(": ") for line in (tmp_path / "map.yaml").read_text().splitlines())
    assert (said["image"], said["resolution"], said["negate"]) == ("map.pgm", "0.05", "0")
    left, bottom, _ = (float(part) for part in said["origin"].strip("[]").split(","))

    def at(x, y):  # as map_server counts: the last row of the picture is at the origin
        return image[rows - 1 - int((y - bottom) / 0.05), int((x - left) / 0.05)]

    assert at(1.22, 0.92) == OCCUPIED
    assert (image == OCCUPIED).sum() == 1
    assert at(0.0, -0.2) == at(0.0, -0.07) == FREE
    # As far as a car reaches beside its way, three pixels, and no further.
    below = [at(0.0, -0.2 - 0.05 * n) for n in range(5)]
    assert below == [FREE] * 4 + [UNKNOWN]
    assert at(0.0, 0.1) == at(1.0, -0.2) == UNKNOWN
