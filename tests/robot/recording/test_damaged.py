"""Recordings that were cut, damaged or changed: what is left is read, and nothing else is believed."""

import random

import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.recording import open_recording
from ndtorch_robot.recording.streams import STEP
from tests.robot.support.recorded import edited, rewrite, same, write


def read(path):
    recording = open_recording(path)
    return recording, list(recording.steps())


def test_a_recording_cut_anywhere_loses_less_than_a_second(tmp_path):
    """Whatever was written a second before the cut is read; nothing is read that was not written, and it is said."""
    path, cut = tmp_path / "r.mcap", tmp_path / "cut.mcap"
    write(path, 24, strips=True, channels=1)
    data, good = path.read_bytes(), {step.number: step for step in read(path)[1]}
    ends = []  # where the chunks of .3 s end
    assert len(good) == 24
    places = sorted({*np.linspace(0, len(data) - 1, 300).astype(int)})
    last = -1.0
    for at in places:
        cut.write_bytes(data[:at])
        try:
            recording, found = read(cut)
        except InputError:
            assert at < 1500  # not even the beginning
            continue
        assert [step.number for step in found] == list(range(len(found)))
        assert not recording.complete or at > len(data) - 20_000  # in what only finds messages faster
        assert recording.complete or recording.trouble == "its end was not written"
        time = found[-1].time if found else 0.0
        assert time >= last  # what is longer holds more
        last = time
        ends += [len(found)] if not ends or ends[-1] != len(found) else []
    # Every cut leaves whole chunks, and two of these are at most .3 s and a step apart.
    assert ends[-1] == 24
    assert max(np.diff([0, *ends])) <= 10


def test_no_flipped_byte_is_believed(tmp_path):
    """Wherever a byte of a recording changes, the steps that are read are those that were written."""
    path = tmp_path / "r.mcap"
    write(path, 40, strips=True)
    good = {step.number: step for step in read(path)[1]}
    data, chance = path.read_bytes(), random.Random(1)
    for _ in range(100):
        at = chance.randrange(len(data))
        path.write_bytes(data[:at] + bytes([data[at] ^ 1 << chance.randrange(8)]) + data[at + 1 :])
        try:
            recording, found = read(path)
        except InputError:
            continue
        assert len(found) == 40 or recording.missing or recording.damaged or not recording.complete
        for step in found:
            was = good[step.number]
            assert step._replace(frames=None) == was._replace(frames=None)
            assert same(step.frames.left, was.frames.left)
            assert same(step.frames.right, was.frames.right)


def image(message, **changed):
    """The same image with other fields."""
    for name, value in changed.items():
        setattr(message, name, value)
    return ros.to_cdr(message)


@pytest.mark.parametrize(
    "changed",
    [
        {"height": 0},
        {"width": 0, "step": 0},
        {"width": 2**31},
        {"height": 2**31},
        {"encoding": "bayer_rggb8"},
        {"data": np.zeros(0, np.uint8)},
    ],
)
def test_an_image_that_cannot_be_is_damaged(tmp_path, changed):
    """Every checksum fits: whoever writes such an image means it."""
    path = tmp_path / "r.mcap"
    write(path)

    def change(topic, number, data):
        if topic == "/camera/left/image" and number == 0:
            return image(ros.from_cdr(data, "sensor_msgs/msg/Image"), **changed)
        return data

    rewrite(path, change)
    recording, found = read(path)
    assert [step.number for step in found] == [1, 2, 3, 4]
    assert (recording.damaged, recording.complete) == (1, True)
    assert recording.trouble == "a step is damaged, or its frames are not there"


@pytest.mark.parametrize(
    "changed",
    [
        {"time": "now"},
        {"driven": [0.0]},
        {"standing": 3},
        {"placed": [1, 2]},
        {"images": ["left/image"]},
        {"number": {}},
    ],
)
def test_a_step_that_cannot_be_is_damaged(tmp_path, changed):
    path = tmp_path / "r.mcap"
    write(path)
    rewrite(path, lambda topic, n, data: edited(data, lambda v: v | changed) if (topic, n) == (STEP, 3) else data)
    recording, found = read(path)
    assert [step.number for step in found] == [0, 1, 2, 4]
    assert recording.damaged == 1


def test_steps_that_are_missing_are_counted(tmp_path):
    path = tmp_path / "r.mcap"
    write(path)
    rewrite(path, lambda topic, n, data: None if n in (1, 2, 4) else data)
    recording, found = read(path)
    assert [step.number for step in found] == [0, 3]
    assert (recording.missing, recording.complete) == (3, True)
