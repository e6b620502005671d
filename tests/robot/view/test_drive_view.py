"""The recording of a drive: what was written can be read back; the viewer listens on this machine only."""

import sys
from collections import Counter

import numpy as np
import pytest
import torch

import ndtorch_robot.view.opening
from ndtorch.commands import main
from ndtorch.errors import InputError
from ndtorch.navigation import Grid
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive
from ndtorch_robot.evaluation.record import Record
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import RIG
from ndtorch_robot.view import DriveView, Where
from ndtorch_robot.view.drive_view import pieces
from ndtorch_robot.view.opening import open_viewer

rerun = pytest.importorskip("rerun")


def chunks(path, entity):
    from rerun.chunk import RrdReader

    return [c for c in RrdReader(path).stream().to_chunks() if c.entity_path == entity]


def column(chunk, name):
    return chunk.to_record_batch().column(name).to_pylist()


def made_up(path, steps=65):
    """A short drive that nobody drove: along x, one feature straight ahead, one cell of the map."""
    plan, grid, record = load_arena("room"), Grid(0, 4, 0, 4), Record()
    view = DriveView(plan, RIG, RIG.subfields(), {"turn left": 0.15}, Where(path))
    cells = torch.zeros(grid.rows + 2, grid.columns + 2)
    cells[101, 201] = 1.0
    frame = torch.full((1, 3, 480, 640), 90, dtype=torch.uint8)
    for k in range(steps):
        record.time.append(k / 30)
        record.pose.append((1 + 0.01 * k, 2.0, 0.0))
        record.believed.append((1 + 0.0101 * k, 2.0, 0.0))
        record.sides.append(np.array([0.3, 0.4]))
        record.difference.append(0.1)
        record.command.append(DriveCommand(0.5, 1.0))
        record.ranges.append(np.array([[1.5, 0], [0.1, 0], [0.2, 0], [1, 0]], np.float32))
        if k == 0:
            record.placed.append(0)
        view.frame(StereoFrames(frame, frame, k / 30), record, grid, cells)
    view.close(record)
    view.close(record)


def test_everything_written_is_there(tmp_path):
    from rerun.chunk import RrdReader

    path = tmp_path / "new" / "drive.rrd"
    made_up(path)
    reader = RrdReader(path)
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) == 1
    rows, fixed = Counter(), set()
    for chunk in reader.stream().to_chunks():
        if chunk.is_static:
            fixed.add(chunk.entity_path)
        else:
            assert "time" in chunk.timeline_names
            rows[chunk.entity_path] += chunk.num_rows
    assert fixed >= {"/plan/walls", "/cameras/left/fields", "/cameras/right/fields", "/speeds", "/command/curvature"}
    assert rows["/speeds"] == rows["/command/curvature"] == 65
    assert rows["/cameras/left"] == rows["/cameras/right"] == rows["/cameras/left/features"] == 22
    assert rows["/plan/map"] == 3
    assert rows["/plan/path"] == rows["/plan/believed"] == 4  # once a second, and the end

    values = [v for c in chunks(path, "/speeds") if not c.is_static for v in column(c, "Scalars:scalars")]
    assert values[0] == pytest.approx([0.3, 0.4, 0.1, 0.15])
    (cell,) = column(chunks(path, "/plan/map")[0], "Points2D:positions")[0]
    assert cell == pytest.approx([2.005, -1.005])  # the viewer's y points down
    (feature,) = column(chunks(path, "/cameras/left/features")[0], "Points2D:positions")[0]
    assert feature == pytest.approx([319.5 - 430 * np.tan(0.1) + 0.5, RIG.row + 0.5], abs=0.01)


def test_paths_are_cut_where_the_car_was_carried():
    line = np.array([[0, 0], [1, 0], [np.nan, np.nan], [5, 5], [6, 5], [7, 5], [np.nan, np.nan], [9, 9]])
    assert [part.tolist() for part in pieces(line)] == [[[0, 0], [1, 0]], [[5, 5], [6, 5], [7, 5]]]


@pytest.mark.slow
def test_recording_a_drive_changes_nothing(tmp_path):
    config = DriveConfig(arena="curve", seed=1, seconds=0.5)
    recorded = drive(config.model_copy(update={"rrd": tmp_path / "run.rrd"}))
    plain = drive(config)
    assert recorded.record.pose == plain.record.pose
    assert torch.equal(recorded.cells, plain.cells)
    assert sum(c.num_rows for c in chunks(tmp_path / "run.rrd", "/speeds") if not c.is_static) == 15


def test_where_a_recording_cannot_be_written(capsys, tmp_path):
    arguments = ["drive", "--seconds", "1", "--out", str(tmp_path), "--rrd", "/proc/nothing/run.rrd"]
    assert main(arguments) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: cannot write the recording /proc/nothing/run.rrd")
    assert err.count("\n") == 1


def test_viewer_listens_here_only(monkeypatch):
    import socket

    asked = []

    class Viewer:
        def __init__(self, command, **options):
            asked.append(command)
            self.door = socket.create_server(("127.0.0.1", int(command[command.index("--port") + 1])))

        def poll(self):
            return None

    monkeypatch.setattr(ndtorch_robot.view.opening.subprocess, "Popen", Viewer)
    address = open_viewer()
    assert address.startswith("rerun+http://127.0.0.1:")
    assert asked[0][:3] == [sys.executable, "-m", "rerun"]
    assert asked[0][asked[0].index("--bind") + 1] == "127.0.0.1"


def test_viewer_that_does_not_open(monkeypatch):
    monkeypatch.setattr(ndtorch_robot.view.opening.sys, "executable", "/bin/false")
    with pytest.raises(InputError, match="use --rrd FILE instead of --view"):
        open_viewer()
