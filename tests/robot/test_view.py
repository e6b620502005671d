"""The view of a running car: what is in it, and that the car never waits for it."""

import json
import socket
import threading
from types import SimpleNamespace

import numpy as np
import pytest

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch_robot.recording import Recorder
from ndtorch_robot.view import View, open_stream
from tests.robot.support.cars import FAULTS, RIG, FilmCar, bare_loop, moving_world

rerun = pytest.importorskip("rerun")


def film_loop(steps, **navigation):
    return bare_loop(FilmCar(moving_world(steps, RIG)), RIG, controller="published", **navigation)


def rows(path, entity, name):
    """All values of a column, by time."""
    from rerun.chunk import RrdReader

    found = []
    for chunk in RrdReader(path).stream().to_chunks():
        if chunk.entity_path == entity and not chunk.is_static:
            batch = chunk.to_record_batch()
            times = batch.column("time").to_numpy() / np.timedelta64(1, "s")
            found += zip(times, batch.column(name).to_pylist(), strict=True)
    return sorted(found, key=lambda row: row[0])


def check_contents(path, count):
    """What a car that stood from step 31 to 45 must have left."""
    from rerun.chunk import RrdReader

    assert len(RrdReader(path).recordings()) == len(RrdReader(path).blueprints()) == 1
    assert len(rows(path, "/cameras/left", "EncodedImage:blob")) == pytest.approx(count / 3, abs=2)
    assert rows(path, "/cameras/right/features", "Points2D:positions")
    for entity, width in (("/speeds", 3), ("/command/speed", 3), ("/command/curvature", 3), ("/board/battery", 1)):
        values = rows(path, entity, "Scalars:scalars")
        assert len(values) == count
        assert {len(value) for _, value in values} == {width}
    speeds = [value for _, value in rows(path, "/command/speed", "Scalars:scalars")]
    assert all(sent == 0 for _, sent, _ in speeds[32:44])
    assert max(sent for _, sent, _ in speeds[:30]) > 0.3
    words = [(when, text[0]) for when, text in rows(path, "/car", "TextDocument:text")]
    stands = [when for when, text in words if text.startswith("# STANDS\nemergency stop: a key")]
    assert stands == [pytest.approx(31 / 30, abs=0.02)]
    assert FAULTS[0] in words[0][1]
    assert "battery_v 7.4" in words[0][1]
    events = [text[0] for _, text in rows(path, "/events", "TextLog:text")]
    assert "stopped: emergency stop: a key" in events
    assert rows(path, "/floor/path", "LineStrips2D:strips")
    assert len(rows(path, "/floor/car", "Arrows2D:vectors")) == count
    assert len(rows(path, "/floor/map", "Points2D:positions")) == 2  # every two seconds


def test_a_run_and_its_replay(tmp_path, capsys):
    path, again = tmp_path / "new" / "run.rrd", tmp_path / "replay.rrd"
    loop = film_loop(90, half=5.0)
    shown = View(open_stream("run", path), loop.runner, wait=True)
    loop.safe.report = shown.report
    with Recorder(tmp_path / "r.mcap", loop.runner, when_full="wait") as recorder:
        loop.observers += [recorder, shown]
        loop.observers.append(lambda step: loop.safe.emergency("a key") if step.number == 30 else None)
        loop.observers.append(lambda step: loop.safe.resume() if step.number == 45 else None)
        loop.run(88.5 / 30)
    shown.close()
    assert (shown.shown, shown.dropped, shown.failed) == (90, 0, "")
    check_contents(path, 90)
    assert main(["replay", str(tmp_path / "r.mcap"), "--rrd", str(again), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["same"] == 90
    check_contents(again, 90)


def test_a_loop_never_waits_for_a_view_that_hangs_or_breaks(monkeypatch):
    """The viewer takes nothing at all until the loop has ended: drops are counted, and pictures are spared first."""
    free, said, taken = threading.Event(), [], []
    stream = SimpleNamespace(log=lambda *a, **k: None, set_time=lambda *a, **k: None)
    monkeypatch.setattr(View, "handle", lambda self, item: (free.wait(120), taken.append(item[1])))
    loop = film_loop(60)
    slow = View(stream, loop.runner, said.append)
    loop.observers.append(slow)
    assert loop.run(58.5 / 30) == 60
    assert slow.dropped in (29, 30)
    slow.patience = 0.2
    slow.close()
    assert said == [slow.failed] == ["the view hangs: left behind"]
    free.set()
    slow.thread.join(5)
    assert 2 <= sum(step.frames is not None for step in taken) <= 5

    def broken(self, *item):
        raise RuntimeError("no\nviewer")

    monkeypatch.setattr(View, "handle", broken)
    loop = film_loop(30)
    loop.observers.append(View(stream, loop.runner, said.append))
    assert loop.run(28.5 / 30) == 30
    loop.observers[-1].close()
    assert said[1:] == ["the view has ended: RuntimeError: no viewer"]


def test_a_viewer_that_runs_is_found(monkeypatch):
    for address in ("127.0.0.1:port", "127.0.0.1:70000", ":9876"):
        with pytest.raises(InputError, match="--view must be ADDRESS or ADDRESS:PORT"):
            open_stream("live", viewer=address)
    sinks = []
    monkeypatch.setattr(rerun.RecordingStream, "set_sinks", lambda self, *given, **more: sinks.extend(given))
    with socket.create_server(("127.0.0.1", 0)) as door:
        port = door.getsockname()[1]
        open_stream("live", viewer=f"127.0.0.1:{port}")
    assert len(sinks) == 1
    with pytest.raises(InputError, match="`rerun` starts a viewer"):
        open_stream("live", viewer=f"127.0.0.1:{port}")
