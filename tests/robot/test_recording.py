"""Recordings: written without keeping anybody waiting, read as far as they are whole, replayed bit for bit."""

import errno
import json
import subprocess
import sys
import threading

import numpy as np
import pytest
import torch
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.navigation import cut_strips
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot import recording as module
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import DriveCommand, Step, StereoFrames
from ndtorch_robot.recording import STEP, Recorder, make_runner, open_recording, replay
from tests.robot.support.cars import RIG as WORLD_RIG
from tests.robot.support.cars import FilmCar, bare_loop, moving_world
from tests.robot.support.recorded import RIG, STILL, edited, frames, rewrite, same, step, write

CHOICE = NavigatorOptions("published", features=5, feature_position="motion")


def read(path):
    recording = open_recording(path)
    return recording, list(recording.steps())


@pytest.mark.parametrize(("strips", "channels"), [(False, 1), (False, 3), (True, 3)])
def test_what_is_written_is_read(tmp_path, strips, channels):
    recorder = write(tmp_path / "r.mcap", strips=strips, channels=channels)
    assert (recorder.steps, recorder.dropped, recorder.failed) == (5, 0, "")
    recording, steps = read(tmp_path / "r.mcap")
    assert (recording.complete, recording.missing, len(steps)) == (True, 0, 5)
    for n, found in enumerate(steps):
        given = frames(n, strips, channels)
        assert found._replace(frames=None) == step(n)._replace(frames=None)  # to the bit, through decimal digits
        assert found.frames.time == given.time
        assert same(found.frames.left, given.left)
        assert same(found.frames.right, given.right)


def test_of_whole_frames_the_strips_that_the_navigator_reads_are_kept(tmp_path):
    runner = NavigatorRunner(NavigatorOptions("published"), RIG, 30.0)
    write(tmp_path / "r.mcap", runner=runner)
    write(tmp_path / "whole.mcap", runner=runner, whole=True)
    steps = [read(tmp_path / name)[1] for name in ("r.mcap", "whole.mcap")]
    for n, (found, whole) in enumerate(zip(*steps, strict=True)):
        for side in (0, 1):
            assert same(found.frames[side], cut_strips(frames(n)[side], runner.fields[side], RIG))
            assert same(whole.frames[side], frames(n)[side])


class Held(Recorder):
    """A recorder whose thread waits at every step until it is let go."""

    free = threading.Event()

    def handle(self, item):
        self.free.wait(60)
        super().handle(item)


def test_the_loop_never_waits_and_what_is_lost_is_counted(tmp_path):
    Held.free.clear()
    recorder = Held(tmp_path / "r.mcap", size=3)
    for n in range(50):
        recorder(step(n))
    Held.free.set()
    recorder.close()
    assert recorder.steps + recorder.dropped == 50
    assert 3 <= recorder.steps <= 5
    recording, found = read(tmp_path / "r.mcap")
    assert len(found) == recorder.steps
    assert (recording.complete, recording.missing) == (True, recorder.dropped)


def test_files_that_cannot_be_used_are_refused(tmp_path):
    path = tmp_path / "r.mcap"
    write(path)
    for name, message in (("r.mcap", "exists already"), ("s", r"NAME\.mcap"), ("/proc/s.mcap", "cannot record")):
        with pytest.raises(InputError, match=message):
            Recorder(tmp_path / name)
    with Recorder(tmp_path / "s.mcap") as recorder, pytest.raises(InputError, match="only single uint8 frames"):
        recorder(step(0, StereoFrames(torch.zeros(1, 3, 4, 4), torch.zeros(1, 3, 4, 4), 0.0)))
    with pytest.raises(InputError, match="cannot be read"):
        open_recording(tmp_path / "nowhere.mcap")
    for data in (b"", b"{}" * 50, path.read_bytes()[:60]):
        (tmp_path / "other.mcap").write_bytes(data)
        with pytest.raises(InputError, match="not a recording"):
            open_recording(tmp_path / "other.mcap")
    for changed, message in (({"version": "3"}, "version 3"), ({"configuration": "{"}, "configuration cannot")):
        other = tmp_path / f"{message}.mcap"
        write(other)
        rewrite(other, lambda topic, n, data: data, changed)
        with pytest.raises(InputError, match=message):
            open_recording(other)


LONG = """
import sys, time, torch
from ndtorch_robot.ports import DriveCommand, Step, StereoFrames
from ndtorch_robot.recording import Recorder
recorder, still = Recorder(sys.argv[1]), DriveCommand(0, 0)
frame = torch.randint(0, 256, (1, 3, 48, 64), dtype=torch.uint8)
for n in range(1000):
    now = time.monotonic()
    recorder(Step(n, now, StereoFrames(frame, frame, now), still, still, still))
    print(now, flush=True)
    time.sleep(1 / 30)
"""


@pytest.mark.realtime
def test_a_kill_costs_less_than_a_second(tmp_path):
    path = tmp_path / "r.mcap"
    with subprocess.Popen([sys.executable, "-c", LONG, str(path)], stdout=subprocess.PIPE) as process:
        for _ in range(90):
            last = float(process.stdout.readline())
        process.kill()
    recording, found = read(path)
    assert last - found[-1].time < 1.0
    assert not recording.complete
    assert [taken.number for taken in found] == list(range(len(found)))


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), MemoryError()])
def test_a_disk_that_fails_ends_the_recording_and_not_the_drive(tmp_path, monkeypatch, error):
    flush, lines = Recorder.flush, []

    def failing(self):
        if self.steps > 2:
            raise error
        flush(self)

    monkeypatch.setattr(Recorder, "flush", failing)
    monkeypatch.setattr(module, "FLUSH_S", 0.0)
    recorder = write(tmp_path / "r.mcap", count=10, size=1, report=lines.append)
    assert recorder.steps == 2 == len(read(tmp_path / "r.mcap")[1])
    assert recorder.steps + recorder.dropped == 10
    assert lines == [recorder.failed]
    assert ("No space left" in recorder.failed) == isinstance(error, OSError)


def test_the_disk_is_not_filled(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "RESERVE", 10**18)
    recorder = write(tmp_path / "r.mcap")
    assert "less than 1000000000000 MB are left" in recorder.failed


def test_a_recording_cut_anywhere_is_read_as_far_as_it_is_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "FLUSH_S", 0.0)
    path, cut, counts = tmp_path / "r.mcap", tmp_path / "cut.mcap", []
    write(path, 12, strips=True, channels=1)
    data = path.read_bytes()
    for at in np.linspace(2000, len(data) - 1, 100).astype(int):
        cut.write_bytes(data[:at])
        recording, found = read(cut)
        assert [taken.number for taken in found] == list(range(len(found)))
        assert not recording.complete or at > len(data) - 20_000  # in the index
        counts.append(len(found))
    assert counts == sorted(counts)
    assert counts[-1] == 12
    assert max(np.diff(counts)) <= 2


@pytest.mark.parametrize(
    "changed",
    [{"time": "now"}, {"driven": [0.0]}, {"standing": 3}, {"placed": [1, 2]}, {"images": ["/x"]}, {"number": {}}],
)
def test_a_step_that_cannot_be_is_left_out(tmp_path, changed):
    path = tmp_path / "r.mcap"
    write(path)
    rewrite(path, lambda topic, n, data: edited(data, lambda v: v | changed) if (topic, n) == (STEP, 3) else data)
    recording, found = read(path)
    assert [taken.number for taken in found] == [0, 1, 2, 4]
    assert recording.missing == 1


def record(path, count=60):
    """A drive of the navigator alone, its wheels slipping a little."""
    runner, driven = NavigatorRunner(CHOICE, WORLD_RIG, 30.0), STILL
    with Recorder(path, runner, when_full="wait") as recorder:
        for n, given in enumerate(moving_world(count, WORLD_RIG, grain=1)):
            placed = (0.0, 0.0, 0.0) if n in (0, 40) else None
            command = runner.step(given, driven, placed)
            recorder(Step(n, given.time, given, driven, command, command, runner.state, placed=placed))
            driven = DriveCommand(command.speed * 0.97, command.curvature + 0.01)


def test_other_frames_give_other_commands(tmp_path, capsys):
    path, first = tmp_path / "r.mcap", {}
    record(path)

    def change(topic, n, data):
        return first.setdefault(topic, data) if topic.startswith("/camera/left/") and 5 <= n < 35 else data

    rewrite(path, change)
    assert main(["replay", str(path), "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert 5 < result["first_different"] < 35


def test_gaps_and_damage_leave_the_rest_compared(tmp_path, capsys):
    path = tmp_path / "r.mcap"
    record(path)
    rewrite(path, lambda topic, n, data: None if n in (10, 11) else b"" if (topic, n) == (STEP, 30) else data)
    assert main(["replay", str(path), "--json"]) == 3
    result = json.loads(capsys.readouterr().out)
    assert (result["steps"], result["missing"], result["complete"]) == (57, 3, True)
    assert result["same"] >= 10
    rewrite(path, lambda topic, n, data: None if topic == STEP else data)
    assert main(["replay", str(path)]) == 3
    assert "nothing was compared" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(("controller", "whole"), [("ranging", False), ("goal", False), ("goal", True)])
def test_a_simulated_drive_replays_bit_for_bit(tmp_path, capsys, controller, whole):
    """Driven into a wall and put back, so that restarts are replayed too; kept is a tenth of 47 kB of pixels."""
    seconds, path, rrd = 0.4 if whole else 7, tmp_path / "r.mcap", tmp_path / "drive.rrd" if whole else None
    config = DriveConfig(controller=controller, arena="hallway", seed=1, seconds=seconds, record=path, rrd=rrd)
    result = drive(config, steer=lambda command: DriveCommand(0.5, 0.6))
    assert result.summary["recording"]["steps"] == len(result.record.array("time"))
    assert whole or len(result.record.placed) > 1
    assert whole or path.stat().st_size < 4700 * result.summary["recording"]["steps"]
    assert main(["replay", str(path), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["steps"] == again["same"] == len(result.record.array("time"))


def test_the_loop_of_a_car_replays_bit_for_bit(tmp_path):
    """It is stopped in between and resumed, and its frames are not usable for two steps."""
    given = list(moving_world(90, WORLD_RIG))
    given[60] = given[61] = given[0]._replace(left=torch.zeros(1, 3, 4, 4, dtype=torch.uint8))
    loop = bare_loop(FilmCar(given), WORLD_RIG, controller="published", half=5.0)
    path = tmp_path / "r.mcap"
    with Recorder(path, loop.runner, when_full="wait") as recorder:
        loop.observers.append(recorder)
        loop.observers.append(lambda taken: loop.safe.emergency("a key") if taken.number == 20 else None)
        loop.observers.append(lambda taken: loop.safe.resume() if taken.number == 40 else None)
        assert loop.run(88.5 / 30) == 90
    recording, steps = read(path)
    assert steps[30].standing == "emergency stop: a key"
    assert steps[30].telemetry["battery_v"] == 7.4
    lines, shown = [], []
    for mapping in (False, True):
        result = replay(recording, make_runner(recording.configuration, mapping), [shown.append], lines.append)
        assert (result.steps, result.same) == (88, 88)
    assert lines[0] == "stopped: emergency stop: a key"
    assert shown[-1].state.map is not None
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        odometry = [message for *_, message in reader.iter_decoded_messages(topics=["/odom"])]
    assert len(odometry) == sum(taken.used for taken in steps)
    assert [message.twist.twist.linear.x for message in odometry[:9]] == [taken.driven.speed for taken in steps[:9]]


@pytest.mark.parametrize("configuration", [{}, {"rig": {"width": -1}}, {"rig": []}, {"controller": "juggle"}])
def test_configurations_of_something_else_are_refused(configuration):
    with pytest.raises(InputError):
        make_runner(configuration, mapping=True)
