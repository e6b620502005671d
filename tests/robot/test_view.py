"""The view of a running car: what is in it, and that the car never waits for it."""

import json
import sys
import threading
from collections import Counter

import numpy as np
import pytest
import torch

import ndtorch_robot.commands.replay
import ndtorch_robot.view.car_view
import ndtorch_robot.view.stream
from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.navigation import Navigator
from ndtorch_robot.ports import DriveCommand, Step, StereoFrames
from ndtorch_robot.recording import Recorder
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import RIG as SIM_RIG
from ndtorch_robot.view import Background, CarView, Seen, Where, layout, open_stream, plan_bounds, start_view
from ndtorch_robot.view.observer import ViewSteps
from ndtorch_robot.view.stream import open_server, open_viewer
from tests.robot.support.cars import FAULTS, FilmCar, bare_loop, moving_world
from tests.robot.support.cars import RIG as WORLD_RIG

rerun = pytest.importorskip("rerun")


def start(loop, stream, report=None, wait=False):
    """The view of a loop, and its observer. One that waits shows every step, however busy the machine is."""
    view = start_view(stream, loop.runner, report, wait)
    observer = ViewSteps(view)
    loop.observers.append(observer)
    return view, observer


def stops_for_a_while(loop):
    loop.observers.append(lambda step: loop.safe.emergency("a key") if step.number == 30 else None)
    loop.observers.append(lambda step: loop.safe.resume() if step.number == 45 else None)


def rows(path, entity, name):
    """All values of a column, by time."""
    found = []
    for chunk in chunks(path, entity):
        if not chunk.is_static:
            times = chunk.to_record_batch().column("time").to_numpy()
            found += zip((t / np.timedelta64(1, "s") for t in times), column(chunk, name), strict=True)
    return sorted(found, key=lambda row: row[0])


def check_contents(path, count):
    """What a car that stood from step 31 to 45 must have left."""
    assert len(rows(path, "/cameras/left", "EncodedImage:blob")) == pytest.approx(count / 3, abs=2)
    assert rows(path, "/cameras/right/features", "Points2D:positions")
    for entity, width in (("/speeds", 6), ("/command/speed", 3), ("/command/curvature", 3), ("/board/battery", 1)):
        values = rows(path, entity, "Scalars:scalars")
        assert len(values) == count
        assert {len(value) for _, value in values} == {width}
    speeds = [value for _, value in rows(path, "/command/speed", "Scalars:scalars")]
    assert all(sent == 0 for _, sent, _ in speeds[32:44])
    assert max(sent for _, sent, _ in speeds[:30]) > 0.3
    assert rows(path, "/board/battery", "Scalars:scalars")[0][1] == [7.4]
    words = [(when, text[0]) for when, text in rows(path, "/car", "TextDocument:text")]
    stands = [when for when, text in words if text.startswith("# STANDS\nemergency stop: a key")]
    assert stands == [pytest.approx(31 / 30, abs=0.02)]
    assert FAULTS[0] in words[0][1]
    assert "7.4 V, 3 frames refused" in words[0][1]
    said = [text[0] for _, text in rows(path, "/events", "TextLog:text")]
    assert "stopped: emergency stop: a key" in said
    assert "resumed after: emergency stop: a key" in said
    assert rows(path, "/floor/path/0", "LineStrips2D:strips")
    assert len(rows(path, "/floor/car", "Arrows2D:vectors")) == count
    assert len(rows(path, "/floor/map", "Points2D:positions")) == 2  # every two seconds


def test_a_run_and_its_replay(tmp_path, capsys):
    """Everything is there, of both; neither has a plan or a true pose."""
    from rerun.chunk import RrdReader

    path, again = tmp_path / "new" / "run.rrd", tmp_path / "replay.rrd"
    loop = bare_loop(FilmCar(moving_world(90, WORLD_RIG)), WORLD_RIG, controller="published", map_half_size_m=5.0)
    view, observer = start(loop, open_stream("run", Where(path), layout()), wait=True)
    loop.safe.report = observer.report
    with Recorder(tmp_path / "r.mcap", loop.runner, when_full="wait") as recorder:
        loop.observers.append(recorder)
        stops_for_a_while(loop)
        loop.run(88.5 / 30)
    view.close()
    assert (view.shown, view.dropped, view.failed) == (90, 0, "")
    check_contents(path, 90)
    assert not {c.entity_path for c in RrdReader(path).stream().to_chunks()} & {"/floor/walls", "/floor/believed/0"}
    assert main(["replay", str(tmp_path / "r.mcap"), "--rrd", str(again), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["same"] == 90
    check_contents(again, 90)
    for file in (path, again):
        assert len(RrdReader(file).recordings()) == 1
        assert RrdReader(file).blueprints()


def test_more_floor_is_shown_as_the_car_goes_on(monkeypatch):
    """Seldom, so that what the user has arranged stays for long; the car is always in what is shown."""
    shown = []
    monkeypatch.setattr(ndtorch_robot.view.car_view, "layout", lambda bounds: bounds)
    monkeypatch.setattr(rerun, "send_blueprint", lambda layout, recording: shown.append(layout))
    view = CarView(rerun.RecordingStream("nowhere"), WORLD_RIG, WORLD_RIG.subfields(), {}, None)
    for k in range(1000):
        x, y = 2.0 + 0.001 * k, 1.0 + 0.1 * k
        view.widen(x, y)
        left, right, top, bottom = view.shown
        assert left + 0.5 <= x <= right - 0.5
        assert top + 0.5 <= -y <= bottom - 0.5
    assert len(shown) < 12
    assert shown[0] == (0.0, 4.0, -3.0, 1.0)
    assert view.shown[1] == 4.0


def test_a_loop_never_waits_for_a_view_that_hangs():
    """The viewer takes nothing at all until the loop and the view have ended: drops are counted."""
    free, said, taken = threading.Event(), [], []
    view = Background(lambda item: taken.append(free.wait(120)), lambda: None, size=5, report=said.append)
    loop = bare_loop(FilmCar(moving_world(120, WORLD_RIG)), WORLD_RIG, controller="published")
    loop.observers.append(ViewSteps(view))
    assert loop.run(118.5 / 30) == 120
    assert view.dropped >= 120 - 6
    view.close(patience=0.2)
    assert said == [view.failed] == ["the viewer takes nothing: left behind"]
    assert taken == []
    free.set()


def test_a_view_that_breaks_ends_alone():
    said = []

    def broken(item):
        raise RuntimeError("no\nviewer")

    view = Background(broken, lambda: None, report=said.append)
    loop = bare_loop(FilmCar(moving_world(30, WORLD_RIG)), WORLD_RIG, controller="published")
    loop.observers.append(ViewSteps(view))
    assert loop.run(28.5 / 30) == 30
    view.close()
    assert said == ["the view has ended: RuntimeError: no viewer"]


def test_a_view_that_is_slow_spares_pictures_first():
    seen, gate = [], threading.Event()
    view = Background(lambda item: (gate.wait(120), seen.append(item)), lambda: None, size=30)
    loop = bare_loop(FilmCar(moving_world(40, WORLD_RIG)), WORLD_RIG, controller="published")
    loop.observers.append(ViewSteps(view))
    loop.run(38.5 / 30)
    gate.set()
    view.close()
    pictures = [k for k, item in enumerate(seen) if item.step.frames is not None]
    assert 2 <= len(pictures) <= 5
    assert pictures[-1] <= 15
    assert len(seen) == 40 - view.dropped
    assert len(seen) in (30, 31)  # 30 wait; one more where the thread has taken the first in time


@pytest.mark.parametrize("address", ["", "127.0.0.1:port", "127.0.0.1:70000", ":9876"])
def test_bad_addresses(address):
    with pytest.raises(InputError, match="--view-at must be ADDRESS or ADDRESS:PORT"):
        open_server(address)


def test_a_port_in_use():
    import socket

    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"--view-at 127.0.0.1:{port}: cannot listen there"):
            open_server(f"127.0.0.1:{port}")
    with pytest.raises(InputError, match="cannot listen there"):
        open_server("192.0.2.1")


def test_replay_that_is_served(tmp_path, capsys, monkeypatch):
    """The server listens at the address that was asked for, takes everything, and stays until Ctrl-C."""
    asked, held = [], []
    monkeypatch.setattr(ndtorch_robot.view.stream, "start", lambda options, host, *rest: asked.append((host, options)))
    monkeypatch.setattr(ndtorch_robot.view.stream.atexit, "register", lambda *call: None)

    def interrupted():
        held.append(True)
        raise KeyboardInterrupt

    monkeypatch.setattr(ndtorch_robot.commands.replay.signal, "pause", interrupted)
    sinks = []
    monkeypatch.setattr(rerun, "GrpcSink", lambda address: (sinks.append(address), rerun.FileSink(tmp_path / "s"))[1])
    loop = bare_loop(FilmCar(moving_world(20, WORLD_RIG)), WORLD_RIG, controller="published")
    with Recorder(tmp_path / "r.mcap", loop.runner, when_full="wait") as recorder:
        loop.observers.append(recorder)
        loop.run(18.5 / 30)
    assert main(["replay", str(tmp_path / "r.mcap"), "--view-at", "0.0.0.0:9555"]) == 0
    assert "served at 0.0.0.0:9555 until Ctrl-C" in capsys.readouterr().err
    assert sinks == ["rerun+http://127.0.0.1:9555/proxy"]
    assert asked[0][0] == "0.0.0.0"
    assert "--serve-grpc" in asked[0][1]
    assert held


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
    view = CarView(stream, SIM_RIG, SIM_RIG.subfields(), {"turn left": 0.15}, None, plan)
    navigator = Navigator(SIM_RIG, dt=1 / 30)
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
    assert feature == pytest.approx([319.5 - 430 * np.tan(0.1) + 0.5, SIM_RIG.row + 0.5], abs=0.01)


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
