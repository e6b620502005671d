"""How a recording ends where its program is killed, or its disk is slow, full or fails: it is always said."""

import errno
import os
import subprocess
import sys
import threading
import time

import pytest

from ndtorch_robot.recording import Recorder, open_recording
from ndtorch_robot.recording import recorder as recorder_module
from tests.robot.support.recorded import step, write

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
