"""The recording of a drive: what was written can be read back; the viewer listens on this machine only."""

import sys
from collections import Counter

import numpy as np
import pytest
import torch

import ndtorch_robot.view.stream
from ndtorch.navigation import Navigator
from ndtorch_robot.ports import DriveCommand, Step, StereoFrames
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import RIG
from ndtorch_robot.view import CarView, Seen, Where, layout, open_stream, plan_bounds
from ndtorch_robot.view.stream import open_viewer

rerun = pytest.importorskip("rerun")


def chunks(path, entity):
    from rerun.chunk import RrdReader

    return [c for c in RrdReader(path).stream().to_chunks() if c.entity_path == entity]


def column(chunk, name):
    return chunk.to_record_batch().column(name).to_pylist()


@pytest.fixture
def made_up(tmp_path):
    """A recording of a short drive along x that nobody drove: two steps a pair of frames, moved once."""
    path, plan = tmp_path / "new" / "drive.rrd", load_arena("room")
    stream = open_stream("made up", Where(path), layout(plan_bounds(plan)))
    view = CarView(stream, RIG, RIG.subfields(), {"turn left": 0.15}, None, plan)
    navigator = Navigator(RIG, dt=1 / 30)
    frame = torch.full((1, 3, 480, 640), 90, dtype=torch.uint8)
    _, state = navigator(frame, frame)
    for k in range(65):
        ranges = state.ranges._replace(
            left_range=torch.tensor([1.5, 0]),
            left_angle=torch.tensor([0.1, 0]),
            right_angle=torch.tensor([0.2, 0]),
            valid=torch.tensor([True, False]),
        )
        believed = state.pose._replace(x=torch.tensor(1 + 0.0101 * k), y=torch.tensor(2.0))
        frames = StereoFrames(frame, frame, k / 30) if k % 2 == 0 else None
        truth = (1 + 0.01 * k + 2 * (k > 40), 2.0, 0.0)
        command = DriveCommand(0.5, 1.0)
        seen, placed = state._replace(ranges=ranges, pose=believed), truth if k == 41 else None
        step = Step(k, k / 30, frames, command, command, command, seen, placed=placed)
        view.show(Seen(k / 30, step, truth=truth))
    view.close()
    return path


def test_everything_written_is_there(made_up):
    from rerun.chunk import RrdReader

    reader = RrdReader(made_up)
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) == 1
    rows, fixed = Counter(), set()
    for chunk in reader.stream().to_chunks():
        if chunk.is_static:
            fixed.add(chunk.entity_path)
        else:
            assert "time" in chunk.timeline_names
            rows[chunk.entity_path] += chunk.num_rows
    assert fixed >= {"/floor/walls", "/cameras/left/fields", "/cameras/right/fields", "/speeds", "/command/curvature"}
    assert rows["/speeds"] == rows["/command/curvature"] == rows["/floor/car"] == 65
    assert rows["/cameras/left"] == rows["/cameras/right"] == rows["/cameras/left/features"] == 33
    (feature,) = column(chunks(made_up, "/cameras/left/features")[0], "Points2D:positions")[0]
    assert feature == pytest.approx([319.5 - 430 * np.tan(0.1) + 0.5, RIG.row + 0.5], abs=0.01)


def test_the_true_path_is_cut_where_the_car_was_moved(made_up):
    lines = [column(chunks(made_up, f"/floor/path/{k}")[-1], "LineStrips2D:strips")[-1][0] for k in (0, 1)]
    ends = [(line[0][0], line[-1][0]) for line in lines]
    assert ends == [pytest.approx((1.0, 1.4), abs=0.03), pytest.approx((3.41, 3.64), abs=0.03)]
    believed = column(chunks(made_up, "/floor/believed/1")[-1], "LineStrips2D:strips")[-1][0]
    assert believed[0] == pytest.approx([1.414, -2.0], abs=0.01)  # the viewer's y axis points down


def test_viewer_listens_here_only(monkeypatch):
    import socket

    asked, doors = [], []

    class Viewer:
        def __init__(self, command, **options):
            asked.append(command)
            doors.append(socket.create_server(("127.0.0.1", int(command[command.index("--port") + 1]))))

        def poll(self):
            return None

    monkeypatch.setattr(ndtorch_robot.view.stream.subprocess, "Popen", Viewer)
    address = open_viewer()
    doors[0].close()
    assert address.startswith("rerun+http://127.0.0.1:")
    assert asked[0][:3] == [sys.executable, "-m", "rerun"]
    assert asked[0][asked[0].index("--bind") + 1] == "127.0.0.1"
