"""Writing recordings: nothing lost, nobody kept waiting, and an end that is always said."""

import errno
import json
import os
import random
import subprocess
import sys
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import StereoRig, Strips
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.recording import Recorder, open_recording
from ndtorch_robot.recording import recorder as recorder_module
from ndtorch_robot.recording.streams import checked_line, decode, encode

RIG = StereoRig(width=64, height=48, focal=43.0)
STILL = DriveCommand(0.0, 0.0)


def eye(n, channels=3, height=48, width=64):
    shape = (1, channels, height, width)
    return torch.randint(0, 256, shape, generator=torch.Generator().manual_seed(n), dtype=torch.uint8)


def step(n, strips=False, channels=3):
    if strips:
        left, right = (Strips(eye(4 * n + k, channels, 9, 21), eye(4 * n + k + 1, channels, 1)) for k in (0, 2))
        return StereoFrames(left, right, n / 30)
    return StereoFrames(eye(2 * n, channels), eye(2 * n + 1, channels), n / 30)


def write(folder, count=5, strips=False, channels=3, **options):
    with Recorder(folder, {"program": "test"}, **options) as recorder:
        for n in range(count):
            recorder.record_step(step(n, strips, channels), DriveCommand(0.1 * n, -0.3), DriveCommand(0.5, 1 / 3))
    return recorder


def same(a, b):
    if isinstance(a, Strips):
        return torch.equal(a.field, b.field) and torch.equal(a.row, b.row)
    return torch.equal(a, b)


@pytest.mark.parametrize("kind", ["png", "raw"])
@pytest.mark.parametrize("strips", [False, True])
@pytest.mark.parametrize("channels", [1, 3])
def test_what_is_written_is_read(tmp_path, kind, strips, channels):
    recorder = write(tmp_path / "r", strips=strips, channels=channels, format=kind)
    assert (recorder.steps, recorder.dropped, recorder.failed) == (5, 0, "")
    recording = open_recording(tmp_path / "r")
    steps = list(recording.steps())
    assert recording.complete
    assert recording.lossless
    assert recording.trouble == ""
    assert [s.number for s in steps] == list(range(5))
    for n, found in enumerate(steps):
        true = step(n, strips, channels)
        assert found.frames.time == true.time  # to the bit, through decimal digits
        assert same(found.frames.left, true.left)
        assert same(found.frames.right, true.right)
        assert found.driven == (0.1 * n, -0.3)
        assert found.wanted == (0.5, 1 / 3)
        assert (found.sent, found.placed, found.telemetry) == (found.wanted, None, {})


def test_everything_that_can_be_noted(tmp_path):
    with Recorder(tmp_path / "r", {"rig": 1}) as recorder:
        recorder.record_step(
            step(0), STILL, STILL, {"battery_v": 7.4, "faults": []}, sent=DriveCommand(0.2, 0.0), placed=(1.0, 2.0, 0.1)
        )
    recording = open_recording(tmp_path / "r")
    found = next(recording.steps())
    assert found.telemetry == {"battery_v": 7.4, "faults": []}
    assert found.sent == (0.2, 0.0)
    assert found.placed == (1.0, 2.0, 0.1)
    assert recording.configuration == {"rig": 1}


def test_jpeg_is_near_and_smaller(tmp_path):
    smooth = torch.from_numpy(cv2.GaussianBlur(eye(0)[0].permute(1, 2, 0).numpy(), (0, 0), 5)).permute(2, 0, 1)[None]
    data = encode(smooth, "jpeg")
    found = decode(data, (3, 48, 64), "jpeg")
    assert 0 < (found.int() - smooth.int()).abs().float().mean() < 3
    assert len(data) < len(encode(smooth, "png"))


def test_other_tools_read_the_streams(tmp_path):
    """JPEG one after the other is MJPEG; raw needs nothing but NumPy; PNG ends where PNG ends."""
    write(tmp_path / "j", count=4, format="jpeg")
    film = cv2.VideoCapture(str(tmp_path / "j" / "left.mjpeg"))
    frames = []
    while (got := film.read())[0]:
        frames.append(got[1])
    assert len(frames) == 4
    assert frames[0].shape == (48, 64, 3)
    write(tmp_path / "r", count=4, format="raw")
    raw = np.fromfile(tmp_path / "r" / "right.rgb", np.uint8).reshape(4, 48, 64, 3)
    assert np.array_equal(raw[2], eye(5)[0].permute(1, 2, 0))
    write(tmp_path / "p", count=4)
    parts = (tmp_path / "p" / "left.pngs").read_bytes().split(b"\x89PNG\r\n\x1a\n")
    assert len(parts) == 5
    assert parts[0] == b""
    lines = [json.loads(line) for line in (tmp_path / "p" / "steps.jsonl").read_text().splitlines()]
    assert lines[-1].pop("crc") > 0
    assert lines[-1] == {"end": True, "steps": 4, "without_frames": 0, "dropped": 0}


def slow_down(monkeypatch, seconds=0.05):
    encode = recorder_module.encode

    def slowly(*arguments):
        time.sleep(seconds)
        return encode(*arguments)

    monkeypatch.setattr(recorder_module, "encode", slowly)


def test_the_loop_never_waits(tmp_path, monkeypatch):
    """The writer is a hundred times too slow: the loop notices nothing, and all that is missing is counted."""
    slow_down(monkeypatch)
    recorder = Recorder(tmp_path / "r", {}, queue=3)
    frames, worst = step(0), 0.0
    for _ in range(200):
        began = time.thread_time()
        recorder.record_step(frames, STILL, STILL)
        worst = max(worst, time.thread_time() - began)
    recorder.close()
    assert worst < 0.02
    assert recorder.steps + recorder.dropped == 200
    assert 3 <= recorder.steps - recorder.without_frames <= 10
    assert recorder.dropped >= 120
    recording = open_recording(tmp_path / "r")
    found = list(recording.steps())
    assert len(found) == recorder.steps
    assert sum(s.frames is None for s in found) == recorder.without_frames
    assert recording.complete
    assert json.loads((tmp_path / "r" / "steps.jsonl").read_text().splitlines()[-1])["dropped"] == recorder.dropped


def test_late_frames_are_left_out_of_a_queue_with_room(tmp_path, monkeypatch):
    """What waits longer than `WAIT` is written without its frames, and meanwhile no more frames are let in."""
    now, entered, free = [0.0], threading.Event(), threading.Event()

    def held(*arguments):
        entered.set()
        free.wait(5)
        return encode(*arguments)

    monkeypatch.setattr(recorder_module, "encode", held)
    monkeypatch.setattr(recorder_module, "monotonic", lambda: now[0])
    recorder = Recorder(tmp_path / "r", {}, queue=60)
    assert recorder.record_step(step(0), STILL, STILL)
    entered.wait(5)  # the first is being written, the others wait
    let_in = []
    for n, now[0] in enumerate((0.0, 0.3, 0.39, 0.5), 1):
        let_in.append(recorder.record_step(step(n), STILL, STILL))
    assert let_in == [True, True, True, False]
    free.set()
    while recorder.steps < 5 and recorder.thread.is_alive():
        time.sleep(0.005)
    recorder.close()
    found = [taken.frames is not None for taken in open_recording(tmp_path / "r").steps()]
    assert found == [True, False, True, True, False]


def test_a_simulation_waits(tmp_path, monkeypatch):
    slow_down(monkeypatch, 0.005)
    recorder = write(tmp_path / "r", count=20, queue=2, when_full="wait")
    assert (recorder.steps, recorder.without_frames, recorder.dropped) == (20, 0, 0)


KILLED = """
import sys, time, torch
from pathlib import Path
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.recording import Recorder
recorder = Recorder(Path(sys.argv[1]), {})
frame = torch.zeros(1, 3, 29, 85, dtype=torch.uint8)  # about what is read of a frame
n = 0
while True:
    recorder.record_step(StereoFrames(frame, frame, time.monotonic()), DriveCommand(0, 0), DriveCommand(0, 0))
    print(time.monotonic(), flush=True)
    time.sleep(1 / 30)
"""


@pytest.mark.realtime
def test_a_kill_costs_less_than_a_second(tmp_path):
    with subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path / "r")], stdout=subprocess.PIPE) as process:
        for _ in range(45):
            last = float(process.stdout.readline())
        process.kill()
        last = max([last, *(float(line) for line in process.stdout.read().split())])
    recording = open_recording(tmp_path / "r")
    found = list(recording.steps())
    assert not recording.complete
    assert last - found[-1].time < 1.0
    assert len(found) >= 15


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
    assert len(kept) >= 5
    assert last - kept[-1] < 1.5  # some frames come through all the time
    assert [step.number for step in found] == list(range(len(found)))


def test_a_slow_disk_does_not_hold_the_writing_up(tmp_path, monkeypatch):
    """Forcing onto the disk takes long: steps go on being written, and closing waits for it."""
    monkeypatch.setattr(recorder_module, "SYNC", 0.0)
    fsync, free = os.fsync, threading.Event()
    monkeypatch.setattr(recorder_module.os, "fsync", lambda file: (free.wait(5), fsync(file)))
    recorder = Recorder(tmp_path / "r", {})
    for n in range(10):
        recorder.record_step(step(n), STILL, STILL)
    end = time.monotonic() + 4.0
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
    end = time.monotonic() + 4.0
    while not recorder.failed and time.monotonic() < end:
        recorder.record_step(step(0), STILL, STILL)
        time.sleep(0.02)
    assert recorder.failed, "nothing was said while it recorded"
    recorder.close()
    assert said == [recorder.failed]
    assert "Input/output error" in recorder.failed


@pytest.mark.parametrize("cut", [1, 20, 150, 300])
def test_a_recording_cut_short(tmp_path, cut):
    """Bytes are missing at the end of the lines, or of the frames: what is whole is read."""
    write(tmp_path / "r")
    lines = tmp_path / "r" / "steps.jsonl"
    os.truncate(lines, lines.stat().st_size - cut)
    recording = open_recording(tmp_path / "r")
    found = list(recording.steps())
    assert not recording.complete
    assert 3 <= len(found) <= 5
    assert recording.trouble == "the last line was not written to its end"
    frames = tmp_path / "r" / "right.pngs"
    os.truncate(frames, frames.stat().st_size // 2)
    assert len(list(recording.steps())) == 2
    assert recording.trouble == "the frames of step 2 are damaged, or not wholly there"
    frames.unlink()
    assert list(recording.steps()) == []


def test_a_damaged_line(tmp_path):
    write(tmp_path / "r")
    lines = tmp_path / "r" / "steps.jsonl"
    text = lines.read_text().splitlines()
    text[3] = text[3].replace('"n":3', '"n":')
    lines.write_text("\n".join(text) + "\n")
    recording = open_recording(tmp_path / "r")
    assert [step.number for step in recording.steps()] == [0, 1, 2, 4]
    assert (recording.trouble, recording.damaged, recording.missing) == ("a line is damaged", 1, 0)


@pytest.mark.parametrize("kind", ["png", "raw"])
def test_no_flipped_byte_is_believed(tmp_path, kind):
    """Wherever a byte of a recording changes, the steps that are read are those that were written."""
    write(tmp_path / "r", format=kind)
    good = {step.number: step for step in open_recording(tmp_path / "r").steps()}
    chance = random.Random(1)
    for path in sorted((tmp_path / "r").iterdir()):
        data = path.read_bytes()
        for _ in range(60):
            at = chance.randrange(len(data))
            path.write_bytes(data[:at] + bytes([data[at] ^ 1 << chance.randrange(8)]) + data[at + 1 :])
            try:
                recording = open_recording(tmp_path / "r")
                found = list(recording.steps())
            except InputError:
                continue
            if path.name != "recording.json":
                assert recording.damaged or not recording.complete
            for step in found:
                was = good[step.number]
                assert step._replace(frames=None) == was._replace(frames=None)
                assert same(step.frames.left, was.frames.left)
                assert same(step.frames.right, was.frames.right)
        path.write_bytes(data)


@pytest.mark.parametrize("shape", [[3, 0, 7], [3, 5, 0], [3, -5, -7]])
def test_a_picture_without_pixels_is_damaged(tmp_path, shape):
    """Every checksum fits: whoever writes such a line means it."""
    write(tmp_path / "r", format="raw")
    lines = tmp_path / "r" / "steps.jsonl"
    first, *rest = lines.read_bytes().splitlines(keepends=True)
    line = json.loads(first)
    del line["crc"]
    for place in line["frames"].values():
        place |= {"shape": shape, "bytes": 0, "crc": 0}
    lines.write_bytes(b"".join([checked_line(line), *rest]))
    recording = open_recording(tmp_path / "r")
    assert [step.number for step in recording.steps()] == list(range(1, len(rest)))
    assert "the frames of step 0 are damaged" in recording.trouble


def test_steps_that_are_missing_are_counted(tmp_path):
    write(tmp_path / "r")
    lines = tmp_path / "r" / "steps.jsonl"
    text = lines.read_text().splitlines()
    lines.write_text("\n".join(text[:1] + text[3:]) + "\n")
    recording = open_recording(tmp_path / "r")
    assert [s.number for s in recording.steps()] == [0, 3, 4]
    assert recording.missing == 2


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


def test_bad_input(tmp_path):
    write(tmp_path / "r")
    with pytest.raises(InputError, match="holds a recording already"):
        Recorder(tmp_path / "r", {})
    with pytest.raises(InputError, match="cannot record into this folder"):
        Recorder(Path("/proc/nothing"), {})
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot record into this folder"):
        Recorder(tmp_path / "file", {})
    with pytest.raises(InputError, match="expected format png, jpeg or raw"):
        Recorder(tmp_path / "s", {}, format="gif")
    with Recorder(tmp_path / "s", {}) as recorder, pytest.raises(InputError, match="only single uint8 frames"):
        recorder.record_step(StereoFrames(torch.zeros(1, 3, 4, 4), torch.zeros(1, 3, 4, 4), 0.0), STILL, STILL)
    for name, message in (("nowhere", "not a recording"), ("file", "cannot be read")):
        with pytest.raises(InputError, match=message):
            open_recording(tmp_path / name)
    header = tmp_path / "r" / "recording.json"
    text = header.read_text()
    for old, new, message in (
        ("{", "[", "not the beginning"),
        ("ndtorch recording", "diary", "not the beginning"),
        ('"version": 2', '"version": 3', "version 3"),
    ):
        header.write_text(text.replace(old, new, 1))
        with pytest.raises(InputError, match=message):
            open_recording(tmp_path / "r")
    header.write_text(text)
    (tmp_path / "r" / "steps.jsonl").unlink()
    with pytest.raises(InputError, match="holds no steps"):
        open_recording(tmp_path / "r")


def test_unwritable_folder(tmp_path):
    """Another user's folder; as root nothing is unwritable, so the try is made by someone else."""
    if os.geteuid() != 0:
        (tmp_path / "mine").mkdir(mode=0o500)
        with pytest.raises(InputError, match="Permission denied"):
            Recorder(tmp_path / "mine" / "r", {})
        return
    code = (
        "import os, sys; from pathlib import Path; from ndtorch_robot.recording import Recorder; os.seteuid(65534)\n"
        "try: Recorder(Path(sys.argv[1]), {})\nexcept Exception as e: print(type(e).__name__, e)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "r")], capture_output=True, text=True, check=True)
    assert "InputError" in done.stdout
    assert "Permission denied" in done.stdout


def test_waiting_strips_do_not_hold_their_frames(tmp_path, monkeypatch):
    slow_down(monkeypatch, 0.2)
    whole = eye(0, height=480, width=640)
    strips = Strips(whole[..., 300:320, 50:90], whole[..., 240:241, :])
    with Recorder(tmp_path / "r", {}) as recorder:
        for n in range(3):
            recorder.record_step(StereoFrames(strips, strips, n / 30), STILL, STILL)
        waiting = [picture for step in recorder.waiting for picture in step.frames.values()]
        assert waiting
        assert max(picture.untyped_storage().nbytes() for picture in waiting) < 5000
    found = list(open_recording(tmp_path / "r").steps())
    assert torch.equal(found[2].frames.left.field, strips.field)
