"""Recordings that were cut, damaged or changed: what is left is read, and nothing else is believed."""

import json
import os
import random

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch_robot.recording import open_recording
from ndtorch_robot.recording.reading import Recording
from ndtorch_robot.recording.streams import checked_line
from tests.robot.support.recorded import same, write


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


@pytest.mark.parametrize(("largest", "read"), [(1000, True), (999, False)])
def test_a_picture_of_more_pixels_than_any_camera_has_is_damaged(tmp_path, monkeypatch, largest, read):
    """It is refused before anything is made for it."""
    monkeypatch.setattr("ndtorch_robot.recording.reading.LARGEST", largest)
    monkeypatch.setattr(Recording, "bytes_of", lambda self, *where: b"")
    made = []

    def decode(data, shape, kind):
        made.append(shape)
        return torch.zeros(shape)

    monkeypatch.setattr("ndtorch_robot.recording.reading.decode", decode)
    write(tmp_path / "r", format="raw")
    where = {name: {"shape": [1, 25, 40], "at": 0, "bytes": 0, "crc": 0} for name in ("left", "right")}
    assert (open_recording(tmp_path / "r").frames(where, 0.0) is not None) == read
    assert made == ([(1, 25, 40)] * 2 if read else [])


def test_steps_that_are_missing_are_counted(tmp_path):
    write(tmp_path / "r")
    lines = tmp_path / "r" / "steps.jsonl"
    text = lines.read_text().splitlines()
    lines.write_text("\n".join(text[:1] + text[3:]) + "\n")
    recording = open_recording(tmp_path / "r")
    assert [s.number for s in recording.steps()] == [0, 3, 4]
    assert recording.missing == 2
