"""Writing recordings: nothing lost, and nobody kept waiting."""

import errno
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import torch
from mcap.reader import make_reader

from ndtorch.errors import InputError
from ndtorch.navigation import Strips, cut_strips
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import StereoFrames
from ndtorch_robot.recording import Recorder, open_recording
from ndtorch_robot.recording import recorder as recorder_module
from tests.robot.support.recorded import RIG, eye, frames, rewrite, same, step, write


@pytest.mark.parametrize("strips", [False, True])
@pytest.mark.parametrize("channels", [1, 3])
def test_what_is_written_is_read(tmp_path, strips, channels):
    recorder = write(tmp_path / "r.mcap", strips=strips, channels=channels)
    assert (recorder.steps, recorder.dropped, recorder.failed) == (5, 0, "")
    recording = open_recording(tmp_path / "r.mcap")
    steps = list(recording.steps())
    assert recording.complete
    assert recording.trouble == ""
    for n, found in enumerate(steps):
        seen = frames(n, strips, channels)
        assert found._replace(frames=None) == step(n)._replace(frames=None)  # to the bit, through decimal digits
        assert found.frames.time == seen.time
        assert same(found.frames.left, seen.left)
        assert same(found.frames.right, seen.right)
    assert len(steps) == 5


def test_of_whole_frames_the_strips_are_kept_and_some_pictures(tmp_path):
    """What the navigator reads, to the bit; five pictures a second to look at."""
    runner = NavigatorRunner(NavigatorOptions("published"), RIG, 30.0)
    write(tmp_path / "r.mcap", 30, runner=runner)
    for n, found in enumerate(open_recording(tmp_path / "r.mcap").steps()):
        seen = frames(n)
        for side in (0, 1):
            assert same(found.frames[side], cut_strips(seen[side], runner.fields[side], RIG))
    pictures = []
    rewrite(tmp_path / "r.mcap", lambda topic, n, data: pictures.append(n) if topic.endswith("compressed") else data)
    assert len(pictures) == 10


class Held(Recorder):
    """A recorder whose thread is held at every step until it is let go, or nobody did so."""

    gave_up = False

    def write(self, waiting):
        self.entered.set()
        self.gave_up |= not self.free.wait(120)
        super().write(waiting)


@pytest.fixture
def held(monkeypatch):
    monkeypatch.setattr(Held, "entered", threading.Event(), raising=False)
    monkeypatch.setattr(Held, "free", threading.Event(), raising=False)
    return Held


def test_the_loop_never_waits(tmp_path, held):
    """The writer is stuck until the loop is over: the loop notices nothing, and all that is missing is counted."""
    recorder, taken = held(tmp_path / "r.mcap", queue=3), step(0)
    for _ in range(200):
        recorder(taken)
    held.free.set()
    recorder.close()
    assert not recorder.gave_up
    assert recorder.steps + recorder.dropped == 200
    assert 1 <= recorder.steps - recorder.without_frames <= 4
    assert recorder.dropped >= 120
    recording = open_recording(tmp_path / "r.mcap")
    found = list(recording.steps())
    assert len(found) == recorder.steps
    assert sum(s.frames is None for s in found) == recorder.without_frames
    assert recording.complete
    assert recording.missing == recorder.dropped


def test_late_frames_are_left_out_of_a_queue_with_room(tmp_path, monkeypatch, held):
    """What waits longer than `WAIT` is written without its frames, and meanwhile no more frames are let in."""
    now = [0.0]
    monkeypatch.setattr(recorder_module, "monotonic", lambda: now[0])
    recorder = held(tmp_path / "r.mcap", queue=60)
    assert recorder.record(step(0))
    held.entered.wait(120)  # the first is being written, the others wait
    let_in = []
    for n, now[0] in enumerate((0.0, 0.3, 0.39, 0.5), 1):
        let_in.append(recorder.record(step(n)))
    assert let_in == [True, True, True, False]
    held.free.set()
    while recorder.steps < 5 and recorder.thread.is_alive():
        time.sleep(0.005)
    recorder.close()
    found = [taken.frames is not None for taken in open_recording(tmp_path / "r.mcap").steps()]
    assert found == [True, False, True, True, False]


def test_a_long_recording_is_in_parts_that_are_read_as_one(tmp_path, monkeypatch):
    """The index of a part leaves the memory with it."""
    monkeypatch.setattr(recorder_module, "PART", 1.0)
    monkeypatch.setattr(recorder_module, "FLUSH", 0.1)
    recorder = write(tmp_path / "r.mcap", count=75, when_full="wait")
    assert (recorder.steps, recorder.dropped, recorder.failed) == (75, 0, "")
    assert [part.name for part in recorder.parts] == ["r.mcap", "r-2.mcap", "r-3.mcap"]
    recording = open_recording(tmp_path / "r.mcap")
    assert [found.number for found in recording.steps()] == list(range(75))
    assert (recording.complete, recording.trouble, recording.missing) == (True, "", 0)
    for part in recorder.parts:
        with part.open("rb") as file:
            summary = make_reader(file).get_summary()
        assert 0 < len(summary.chunk_indexes) < 15
    second = (tmp_path / "r-2.mcap").rename(tmp_path / "kept.mcap")
    assert len(list(recording.steps())) < 40
    assert not recording.complete
    assert "r-2.mcap: cannot be read" in recording.trouble
    second.rename(tmp_path / "r-2.mcap")
    (tmp_path / "r.mcap").unlink()
    with pytest.raises(InputError, match="exists already"):
        Recorder(tmp_path / "r.mcap")


def test_a_simulation_waits(tmp_path, monkeypatch):
    write_step = Recorder.write
    monkeypatch.setattr(Recorder, "write", lambda self, waiting: (time.sleep(0.005), write_step(self, waiting)))
    recorder = write(tmp_path / "r.mcap", count=20, queue=2, when_full="wait")
    assert (recorder.steps, recorder.without_frames, recorder.dropped) == (20, 0, 0)


def test_bad_input(tmp_path):
    path = tmp_path / "r.mcap"
    write(path)
    with pytest.raises(InputError, match="exists already"):
        Recorder(path)
    with pytest.raises(InputError, match="cannot record into this file"):
        Recorder(Path("/proc/nothing.mcap"))
    with pytest.raises(InputError, match=r"a recording is a file NAME\.mcap"):
        Recorder(tmp_path / "s")
    with Recorder(tmp_path / "s.mcap") as recorder, pytest.raises(InputError, match="only single uint8 frames"):
        recorder(step(0, StereoFrames(torch.zeros(1, 3, 4, 4), torch.zeros(1, 3, 4, 4), 0.0)))
    with pytest.raises(InputError, match="cannot be read"):
        open_recording(tmp_path / "nowhere.mcap")
    for data, message in ((b"", "not a recording"), (b"{}" * 50, "not a recording"), (path.read_bytes()[:60], "not a")):
        (tmp_path / "other.mcap").write_bytes(data)
        with pytest.raises(InputError, match=message):
            open_recording(tmp_path / "other.mcap")
    for changed, message in (
        ({"version": "4"}, "version 4, this program reads version 3"),
        ({"configuration": '{"a": 1}'}, "checksum"),
        ({"configuration": "{"}, "not the beginning"),
    ):
        write(tmp_path / f"{message[:3]}.mcap")
        rewrite(tmp_path / f"{message[:3]}.mcap", lambda topic, n, data: data, changed)
        with pytest.raises(InputError, match=message):
            open_recording(tmp_path / f"{message[:3]}.mcap")


def test_a_recording_of_an_older_version_says_what_replays_it(tmp_path):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "recording.json").write_text('{"format": "ndtorch recording", "version": 2}')
    with pytest.raises(InputError, match=r"ndtorch-robot==0\.2\.0 replays it"):
        open_recording(tmp_path / "old")


def test_waiting_strips_do_not_hold_their_frames(tmp_path, held):
    whole = eye(0, height=480, width=640)
    strips = Strips(whole[..., 300:320, 50:90], whole[..., 240:241, :])
    with held(tmp_path / "r.mcap") as recorder:
        for n in range(3):
            recorder(step(n, StereoFrames(strips, strips, n / 30)))
        waiting = [image for taken in recorder.waiting for image in taken.images.values()]
        held.free.set()
    assert waiting
    assert max(image.untyped_storage().nbytes() for image in waiting) < 5000
    found = list(open_recording(tmp_path / "r.mcap").steps())
    assert torch.equal(found[2].frames.left.field, strips.field)


STARVED = """
import sys, time, torch
from pathlib import Path
from ndtorch_robot.ports import DriveCommand, Step, StereoFrames
from ndtorch_robot.recording import Recorder
class Slow(Recorder):  # a processor that others keep busy
    def write(self, waiting):
        time.sleep(0.14 if waiting.images else 0.0)
        super().write(waiting)
torch.set_num_threads(1)
recorder = Slow(Path(sys.argv[1]))
frame, still = torch.randint(0, 256, (1, 3, 480, 640), dtype=torch.uint8), DriveCommand(0, 0)
began = time.monotonic()
for n in range(1000):
    now = time.monotonic()
    recorder(Step(n, now, StereoFrames(frame, frame, now), still, still, still))
    print(time.monotonic(), flush=True)
    time.sleep(max(0.0, began + (n + 1) / 30 - time.monotonic()))
"""


@pytest.mark.realtime
def test_a_kill_costs_less_than_a_second_with_whole_frames(tmp_path):
    """Two pictures take four times as long as there is time: frames are left out rather than written late."""
    path = tmp_path / "r.mcap"
    with subprocess.Popen([sys.executable, "-c", STARVED, str(path)], stdout=subprocess.PIPE) as process:
        for _ in range(90):
            last = float(process.stdout.readline())
        process.kill()
        last = max([last, *(float(line) for line in process.stdout.read().split())])
    found = list(open_recording(path).steps())
    print(f"lost {last - found[-1].time:.3f} s")
    assert last - found[-1].time < 1.0
    kept = [step.time for step in found if step.frames is not None]
    # One at a time, each the slower the busier the machine is; the share of time is not the recorder's.
    assert len(kept) >= 3
    assert last - kept[-1] < 1.5  # some frames come through all the time
    assert [step.number for step in found] == list(range(len(found)))


def test_a_slow_disk_does_not_hold_the_writing_up(tmp_path, monkeypatch):
    """Forcing onto the disk takes long: steps go on being written, and closing waits for it."""
    monkeypatch.setattr(recorder_module, "FLUSH", 0.0)
    fsync, free = os.fsync, threading.Event()
    monkeypatch.setattr(recorder_module.os, "fsync", lambda file: (free.wait(90), fsync(file)))
    recorder = Recorder(tmp_path / "r.mcap")
    for n in range(10):
        recorder(step(n))
    end = time.monotonic() + 60.0
    while recorder.kept[0] < 10 and time.monotonic() < end:
        time.sleep(0.01)
    assert recorder.kept[0] == 10
    assert len(list(open_recording(tmp_path / "r.mcap").steps())) == 10
    free.set()
    recorder.close()
    assert recorder.failed == ""


def test_a_disk_that_fails_late(tmp_path, monkeypatch):
    """The disk says only when it is forced that it has taken nothing."""
    monkeypatch.setattr(recorder_module, "FLUSH", 0.0)

    def failing(file):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(recorder_module.os, "fsync", failing)
    said = []
    recorder = Recorder(tmp_path / "r.mcap", report=said.append)
    end = time.monotonic() + 60.0
    while not recorder.failed and time.monotonic() < end:
        recorder(step(0))
        time.sleep(0.02)
    assert recorder.failed, "nothing was said while it recorded"
    recorder.close()
    assert said == [recorder.failed]
    assert "Input/output error" in recorder.failed


FULL = """
import resource, sys, torch
from pathlib import Path
from ndtorch_robot.ports import DriveCommand, Step, StereoFrames
from ndtorch_robot.recording import Recorder
resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, 500_000))
said = []
recorder = Recorder(Path(sys.argv[1]), when_full="wait", report=said.append)
still = DriveCommand(0, 0)
for n in range(100):
    frames = torch.randint(0, 256, (2, 1, 3, 48, 64), dtype=torch.uint8)
    recorder(Step(n, n / 30, StereoFrames(*frames, n / 30), still, still, still))
recorder.close()
recorder(Step(100, 9.0, None, still, still, still))
print(recorder.steps, recorder.dropped, recorder.number, said)
"""


def test_files_that_may_not_grow(tmp_path):
    """A disk that takes no more, by the system's limit of file size: driving goes on, and it is said once."""
    path = tmp_path / "r.mcap"
    done = subprocess.run([sys.executable, "-c", FULL, str(path)], capture_output=True, text=True, check=True)
    steps, dropped, number, said = done.stdout.split(maxsplit=3)
    assert int(steps) + int(dropped) == int(number) == 101
    assert said.count(f"has stopped after {steps} steps: File too large") == 1
    assert done.stderr == ""
    recording = open_recording(path)
    assert len(list(recording.steps())) == int(steps) > 10
    assert not recording.complete


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), MemoryError()])
def test_a_disk_that_fails(tmp_path, monkeypatch, error):
    """The steps of the chunk that was not written are lost with those that wait."""
    flush, said = Recorder.flush, []

    def failing(self):
        if self.steps > 2:
            raise error
        flush(self)

    monkeypatch.setattr(Recorder, "flush", failing)
    monkeypatch.setattr(recorder_module, "FLUSH", 0.0)
    recorder = write(tmp_path / "r.mcap", count=10, when_full="wait", queue=1, report=said.append)
    assert recorder.steps == 2 == len(list(open_recording(tmp_path / "r.mcap").steps()))
    assert recorder.dropped == 8
    assert said == [recorder.failed]
    assert ("No space left" in recorder.failed) == isinstance(error, OSError)
    assert threading.active_count() < 20


def test_the_disk_is_not_filled_to_the_brim(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, "FLUSH", 0.0)
    recorder = write(tmp_path / "r.mcap", reserve=10**18)
    assert recorder.steps == 1
    assert "less than 1000000000000 MB are left" in recorder.failed
