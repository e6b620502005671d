"""Driving a recording again: bit for bit, as far as a cut recording goes, and flat in memory."""

import json
import random

import numpy as np
import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot import ros_messages as ros
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import DriveCommand, Step
from ndtorch_robot.recording import Recorder, make_runner, open_recording, replay
from ndtorch_robot.recording.streams import STEP
from tests.robot.support.cars import RIG, FilmCar, bare_loop, moving_world
from tests.robot.support.recorded import STILL, edited, rewrite, same, write

CHOICE = NavigatorOptions("published", features=5, feature_position="motion")


def record(path, count=60):
    """A drive of the navigator alone, its wheels slipping a little."""
    runner, driven, commands = NavigatorRunner(CHOICE, RIG, 30.0), STILL, []
    with Recorder(path, runner, when_full="wait") as recorder:
        for n, frames in enumerate(moving_world(count, RIG, grain=1)):
            placed = (0.0, 0.0, 0.0) if n in (0, 40) else None
            command = runner.step(frames, driven, placed)
            recorder(Step(n, frames.time, frames, driven, command, command, runner.state, placed=placed))
            driven = DriveCommand(command.speed * 0.97, command.curvature + 0.01)
            commands.append(command)
    return commands


def test_another_program_is_noticed(tmp_path, capsys):
    """With other frames, a left eye that stands still, the commands must differ."""
    path, first = tmp_path / "r.mcap", {}
    record(path)

    def change(topic, n, data):
        if not topic.startswith("/camera/left/") or not 5 <= n < 35:
            return data
        return first.setdefault(topic, data)

    rewrite(path, change)
    assert main(["replay", str(path), "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert 5 < result["first_different"] < 35
    assert result["curvature_difference"] > 0.1
    assert main(["replay", str(path)]) == 1
    assert "commands differ, the first in step" in capsys.readouterr().out


def test_gaps_are_told(tmp_path, capsys):
    path = tmp_path / "r.mcap"
    record(path)

    def change(topic, n, data):
        if n in (10, 11):
            return None
        return edited(data, lambda values: values | {"images": []}) if (topic, n) == (STEP, 20) else data

    rewrite(path, change)
    assert main(["replay", str(path)]) == 3
    assert "1 steps without frames and 2 lost ones" in capsys.readouterr().out


def test_damage_leaves_the_rest_checked(tmp_path, capsys):
    path = tmp_path / "r.mcap"
    record(path)
    rewrite(path, lambda topic, n, data: b"" if (topic, n) == (STEP, 30) else data)
    assert main(["replay", str(path), "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert (told["steps"], told["damaged"], told["complete"]) == (59, 1, True)
    assert told["same"] >= 30
    rewrite(path, lambda topic, n, data: None if topic == STEP else data)
    assert main(["replay", str(path)]) == 3
    out = capsys.readouterr().out
    assert "nothing was compared" in out
    assert "bit for bit" not in out


@pytest.mark.slow
@pytest.mark.parametrize("whole", [False, True])
def test_a_simulated_drive_bit_for_bit(tmp_path, capsys, whole):
    """Driven into a wall and put back, so that restarts are replayed too."""
    config = DriveConfig(
        arena="hallway", seed=1, seconds=0.4 if whole else 7, full_frames=whole, record=tmp_path / "r.mcap"
    )
    result = drive(config, steer=lambda command: DriveCommand(0.5, 0.6))
    assert result.summary["recording"]["failed"] == ""
    assert result.summary["recording"]["steps"] == len(result.record.time)
    assert whole or len(result.record.placed) > 1
    assert main(["replay", str(tmp_path / "r.mcap"), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["steps"] == again["same"] == len(result.record.time)
    assert again["complete"]


@pytest.mark.parametrize(
    ("configuration", "message"),
    [
        ({}, "cannot be used: KeyError"),
        ({"rig": {}, "map_m": None, "near_check": True}, "cannot be used: KeyError"),
        ({"rig": {"width": -1}, "rate_hz": 30, "map_m": None, "near_check": True}, "width"),
        ({"rig": {}, "rate_hz": 30, "map_m": None, "near_check": True, "controller": "juggle"}, "juggle"),
        ({"rig": {}, "rate_hz": 30, "map_m": [1, 0, 0, 1, 1], "near_check": True}, "expected left < right"),
        ({"rig": [], "rate_hz": 30, "map_m": None, "near_check": True}, "cannot be used: TypeError"),
    ],
)
def test_bad_configurations(configuration, message):
    with pytest.raises(InputError, match=message):
        make_runner(configuration, mapping=True)


def test_a_car_that_was_blind_for_a_while(tmp_path):
    """As the loop of a car does: no frames, then frames that are not trusted, then a navigator that begins anew."""
    runner, still, interrupted = NavigatorRunner(CHOICE, RIG, 30.0), STILL, False
    with Recorder(tmp_path / "r.mcap", runner, when_full="wait") as observe:
        for n, frames in enumerate(moving_world(60, RIG)):
            if 20 <= n < 30:
                seen = None if n < 25 else frames
                told = {"standing": "no frames", "used": False, "telemetry": {"battery_v": 7.2}}
                observe(Step(n, n / 30, seen, still, still, still, **told))
                interrupted = True
                continue
            wanted = runner.step(frames, still, anew=interrupted)
            observe(Step(n, n / 30, frames, still, wanted, still, runner.state, restarted=interrupted))
            interrupted = False
    recording = open_recording(tmp_path / "r.mcap")
    steps = list(recording.steps())
    assert [step.number for step in steps if not step.used] == list(range(20, 30))
    assert [step.number for step in steps if step.frames is None] == list(range(20, 25))
    assert [step.number for step in steps if step.restarted] == [30]
    assert steps[22].time == 22 / 30
    assert steps[22].standing == "no frames"
    assert steps[22].telemetry == {"battery_v": 7.2}
    result = replay(recording, make_runner(recording.configuration))
    assert (result.steps, result.same, result.skipped) == (50, 50, 0)


def test_the_loop_of_a_car_bit_for_bit(tmp_path):
    """It stands in between, while the navigator begins anew with every frame, and sees nothing for two steps."""
    frames = list(moving_world(90, RIG))
    frames[60] = frames[61] = frames[0]._replace(left=torch.zeros(1, 3, 4, 4, dtype=torch.uint8))
    car = FilmCar(frames)
    loop = bare_loop(car, RIG, controller="published", map_half_size_m=5.0)
    anew = []
    with Recorder(tmp_path / "r.mcap", loop.runner, when_full="wait") as recorder:
        loop.observers += [recorder, lambda step: anew.append(step.restarted)]
        loop.observers.append(lambda step: loop.safe.emergency("a key") if step.number == 20 else None)
        loop.observers.append(lambda step: loop.safe.resume() if step.number == 40 else None)
        assert loop.run(88.5 / 30) == 90
    assert 20 < sum(anew) < 60
    recording = open_recording(tmp_path / "r.mcap")
    steps = list(recording.steps())
    assert steps[30].standing == "emergency stop: a key"
    assert steps[30].telemetry["battery_v"] == 7.4
    assert steps[30].telemetry["link"] is None
    for mapping in (False, True):
        result = replay(recording, make_runner(recording.configuration, mapping))
        assert (result.steps, result.same) == (88, 88)


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
