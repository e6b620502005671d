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
from tests.robot.support.recorded import STILL, step, write

STARVED = """
import sys, time, torch
from pathlib import Path
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.recording import Recorder, recorder as module
encode = module.encode
def slowly(*arguments):  # a processor that others keep busy
    time.sleep(0.07)
    return encode(*arguments)
module.encode = slowly
torch.set_num_threads(1)
recorder = Recorder(Path(sys.argv[1]), {})
frame = torch.randint(0, 256, (1, 3, 480, 640), dtype=torch.uint8)
began = time.monotonic()
for n in range(1000):
    recorder.record_step(StereoFrames(frame, frame, time.monotonic()), DriveCommand(0, 0), DriveCommand(0, 0))
    print(time.monotonic(), flush=True)
    time.sleep(max(0.0, began + (n + 1) / 30 - time.monotonic()))
"""


@pytest.mark.realtime
def test_a_kill_costs_less_than_a_second_with_whole_frames(tmp_path):
    """Two pictures take five times as long as there is time: frames are left out rather than written late."""
    with subprocess.Popen([sys.executable, "-c", STARVED, str(tmp_path / "r")], stdout=subprocess.PIPE) as process:
        for _ in range(75):
            last = float(process.stdout.readline())
        process.kill()
        last = max([last, *(float(line) for line in process.stdout.read().split())])
    found = list(open_recording(tmp_path / "r").steps())
    print(f"lost {last - found[-1].time:.3f} s")
    assert last - found[-1].time < 1.0
    kept = [step.time for step in found if step.frames is not None]
    # One at a time, each the slower the busier the machine is; the share of time is not the recorder's.
    assert len(kept) >= 3
    assert last - kept[-1] < 1.5  # some frames come through all the time
    assert [step.number for step in found] == list(range(len(found)))


def test_a_slow_disk_does_not_hold_the_writing_up(tmp_path, monkeypatch):
    """Forcing onto the disk takes long: steps go on being written, and closing waits for it."""
    monkeypatch.setattr(recorder_module, "SYNC", 0.0)
    fsync, free = os.fsync, threading.Event()
    monkeypatch.setattr(recorder_module.os, "fsync", lambda file: (free.wait(90), fsync(file)))
    recorder = Recorder(tmp_path / "r", {})
    for n in range(10):
        recorder.record_step(step(n), STILL, STILL)
    end = time.monotonic() + 60.0
    while recorder.steps < 10 and time.monotonic() < end:
        time.sleep(0.01)
    assert recorder.steps == 10
    assert len(list(open_recording(tmp_path / "r").steps())) == 10
    free.set()
    recorder.close()
    assert recorder.failed == ""


def test_a_disk_that_fails_late(tmp_path, monkeypatch):
    """The disk says only when it is forced that it has taken nothing."""
    monkeypatch.setattr(recorder_module, "SYNC", 0.0)

    def failing(file):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(recorder_module.os, "fsync", failing)
    said = []
    recorder = Recorder(tmp_path / "r", {}, report=said.append)
    end = time.monotonic() + 60.0
    while not recorder.failed and time.monotonic() < end:
        recorder.record_step(step(0), STILL, STILL)
        time.sleep(0.02)
    assert recorder.failed, "nothing was said while it recorded"
    recorder.close()
    assert said == [recorder.failed]
    assert "Input/output error" in recorder.failed


FULL = """
import resource, sys, torch
from pathlib import Path
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.recording import Recorder
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
said = []
recorder = Recorder(Path(sys.argv[1]), {}, format="raw", report=said.append)
frame = torch.zeros(1, 3, 48, 64, dtype=torch.uint8)
kept = [recorder.record_step(StereoFrames(frame, frame, n / 30), DriveCommand(0, 0), DriveCommand(0, 0))
        for n in range(15)]
recorder.close()
recorder.record_step(StereoFrames(frame, frame, 99.0), DriveCommand(0, 0), DriveCommand(0, 0))
print(recorder.steps, recorder.dropped, said)
"""


def test_files_that_may_not_grow(tmp_path):
    """A disk that takes no more, by the system's limit of file size: driving goes on, and it is said once."""
    done = subprocess.run([sys.executable, "-c", FULL, str(tmp_path / "r")], capture_output=True, text=True, check=True)
    steps, dropped, said = done.stdout.split(maxsplit=2)
    assert (int(steps), int(dropped)) == (10, 6)
    assert said.count("has stopped after 10 steps: File too large") == 1
    recording = open_recording(tmp_path / "r")
    assert len(list(recording.steps())) == 10
    assert not recording.complete


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), MemoryError()])
def test_a_disk_that_fails(tmp_path, monkeypatch, error):
    append, said = Recorder.append, []

    def failing(self, file, data):
        if self.steps == 2:
            raise error
        append(self, file, data)

    monkeypatch.setattr(Recorder, "append", failing)
    recorder = write(tmp_path / "r", count=10, when_full="wait", queue=1, report=said.append)
    assert recorder.steps == 2
    assert recorder.dropped == 8
    assert said == [recorder.failed]
    assert ("No space left" in recorder.failed) == isinstance(error, OSError)
    assert threading.active_count() < 20


def test_the_disk_is_not_filled_to_the_brim(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, "SYNC", 0.0)
    recorder = write(tmp_path / "r", reserve=10**18)
    assert recorder.steps == 1
    assert "less than 1000000000000 MB are left" in recorder.failed
