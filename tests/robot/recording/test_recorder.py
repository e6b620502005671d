"""Writing recordings: nothing lost, and nobody kept waiting."""

import json
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Strips
from ndtorch_robot.ports import StereoFrames
from ndtorch_robot.recording import Recorder, open_recording
from ndtorch_robot.recording import recorder as recorder_module
from ndtorch_robot.recording.streams import encode
from tests.robot.support.recorded import STILL, eye, same, step, write


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
    """The writer is stuck until the loop is over: the loop notices nothing, and all that is missing is counted."""
    free = threading.Event()
    monkeypatch.setattr(recorder_module, "encode", lambda *arguments: (free.wait(120), encode(*arguments))[1])
    recorder = Recorder(tmp_path / "r", {}, queue=3)
    frames, worst = step(0), 0.0
    for _ in range(200):
        began = time.thread_time()
        recorder.record_step(frames, STILL, STILL)
        worst = max(worst, time.thread_time() - began)
    free.set()
    recorder.close()
    assert worst < 0.02
    assert recorder.steps + recorder.dropped == 200
    assert 1 <= recorder.steps - recorder.without_frames <= 4
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
        free.wait(120)
        return encode(*arguments)

    monkeypatch.setattr(recorder_module, "encode", held)
    monkeypatch.setattr(recorder_module, "monotonic", lambda: now[0])
    recorder = Recorder(tmp_path / "r", {}, queue=60)
    assert recorder.record_step(step(0), STILL, STILL)
    entered.wait(120)  # the first is being written, the others wait
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
