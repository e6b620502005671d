"""Driving a recording again: bit for bit from lossless frames, as far as a cut recording goes, and flat in memory."""

import json

import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import drive
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.navigator_table import configuration
from ndtorch_robot.ports import DriveCommand, Step
from ndtorch_robot.recording import (
    Recorder,
    RecordSteps,
    make_runner,
    open_recording,
    replay,
)
from ndtorch_robot.recording.streams import checked_line
from tests.robot.support.bare_car import FilmCar, bare_loop
from tests.robot.support.moving_world import RIG, moving_world

CHOICE = NavigatorOptions("published", features=5, feature_position="motion")


def record(folder, count=60, format="png"):
    """A drive of the navigator alone, its wheels slipping a little."""
    runner, driven, commands = NavigatorRunner(CHOICE, RIG, 30.0), DriveCommand(0.0, 0.0), []
    with Recorder(folder, configuration(CHOICE, RIG, 30.0), format=format, when_full="wait") as recorder:
        for n, frames in enumerate(moving_world(count, RIG, grain=1)):
            placed = (0.0, 0.0, 0.0) if n in (0, 40) else None
            command = runner.step(frames, driven, placed)
            recorder.record_step(frames, driven, command, placed=placed)
            driven = DriveCommand(command.speed * 0.97, command.curvature + 0.01)
            commands.append(command)
    return commands


def test_another_program_is_noticed(tmp_path, capsys):
    """With another baseline nothing changes for the eyes; with other frames the commands must differ."""
    record(tmp_path / "r")
    stream = tmp_path / "r" / "left.pngs"
    lines = (tmp_path / "r" / "steps.jsonl").read_text().splitlines()
    first, later = (json.loads(line)["frames"]["left"] for line in (lines[5], lines[30]))
    swapped = lines[:]
    for n in range(5, 35):  # the left eye stands still
        values = json.loads(lines[n])
        values["frames"]["left"] = first
        del values["crc"]
        swapped[n] = checked_line(values).decode().strip()
    assert first != later
    assert stream.exists()
    (tmp_path / "r" / "steps.jsonl").write_text("\n".join(swapped) + "\n")
    assert main(["replay", str(tmp_path / "r"), "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert 5 < result["first_different"] < 35
    assert result["curvature_difference"] > 0.1
    assert main(["replay", str(tmp_path / "r")]) == 1
    assert "commands differ, the first in step" in capsys.readouterr().out


def test_gaps_are_told(tmp_path, capsys):
    record(tmp_path / "r")
    lines = tmp_path / "r" / "steps.jsonl"
    text = lines.read_text().splitlines()
    bare = {key: value for key, value in json.loads(text[20]).items() if key not in ("frames", "crc")}
    lines.write_text("\n".join([*text[:10], *text[12:20], checked_line(bare).decode().strip(), *text[21:]]) + "\n")
    assert main(["replay", str(tmp_path / "r")]) == 3
    assert "1 steps without frames and 2 lost ones" in capsys.readouterr().out


def test_damage_leaves_the_rest_checked(tmp_path, capsys):
    record(tmp_path / "r")
    lines = tmp_path / "r" / "steps.jsonl"
    text = lines.read_bytes().splitlines(keepends=True)
    lines.write_bytes(b"".join([*text[:30], text[30].replace(b"0", b"1", 1), *text[31:]]))
    assert main(["replay", str(tmp_path / "r"), "--json"]) == 3
    told = json.loads(capsys.readouterr().out)
    assert (told["steps"], told["damaged"], told["complete"]) == (59, 1, True)
    assert told["same"] >= 30
    lines.write_bytes(b"{}\n" + text[-1])
    assert main(["replay", str(tmp_path / "r")]) == 3
    out = capsys.readouterr().out
    assert "nothing was compared" in out
    assert "bit for bit" not in out


@pytest.mark.slow
@pytest.mark.parametrize("whole", [False, True])
def test_a_simulated_drive_bit_for_bit(tmp_path, capsys, whole):
    """Driven into a wall and put back, so that restarts are replayed too."""
    config = DriveConfig(arena="hallway", seed=1, seconds=0.4 if whole else 7, full_frames=whole, record=tmp_path / "r")
    result = drive(config, steer=lambda command: DriveCommand(0.5, 0.6))
    assert result.summary["recording"]["failed"] == ""
    assert result.summary["recording"]["steps"] == len(result.record.time)
    assert whole or len(result.record.placed) > 1
    assert main(["replay", str(tmp_path / "r"), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["steps"] == again["same"] == len(result.record.time)
    assert again["complete"]


def test_a_full_disk_does_not_stop_the_drive(tmp_path, capsys, monkeypatch):
    append = Recorder.append

    def failing(self, file, data):
        if self.steps == 30:
            raise OSError(28, "No space left on device")
        append(self, file, data)

    monkeypatch.setattr(Recorder, "append", failing)
    monkeypatch.setattr("ndtorch_robot.evaluation.plots.write_plots", lambda result, folder: None)
    assert main(["drive", "--seconds", "2", "--out", str(tmp_path / "o"), "--record", str(tmp_path / "r")]) == 1
    err = capsys.readouterr().err
    assert "has stopped after 30 steps: No space left on device" in err
    summary = json.loads((tmp_path / "o" / "summary.json").read_text())
    assert summary["simulated_seconds"] == 2.0
    assert summary["recording"]["steps"] == 30


@pytest.mark.parametrize(
    ("configuration", "message"),
    [
        ({"program": "juggle"}, "made by 'juggle', which cannot be replayed"),
        ({"program": "navigator", "rig": {}}, "cannot be used: KeyError"),
        ({"program": "navigator", "rig": {"width": -1}, "rate_hz": 30, "features": 5, "angle": "atan"}, "width"),
        ({"program": "drive", "drive": {"hue": 3}, "rig": {}, "rate_hz": 30}, "unknown key 'hue'"),
        ({"program": "drive", "drive": {}, "rig": {}}, "cannot be used: KeyError"),
    ],
)
def test_bad_configurations(configuration, message):
    with pytest.raises(InputError, match=message):
        make_runner(configuration)


def test_recordings_of_version_0_2_have_other_names():
    old = {"controller": "goal", "ranging": "search", "cruise": 0.3, "to": "4,0"}
    rig = {"width": 640, "height": 480}
    for table in ({"program": "navigator", **old}, {"program": "drive", "drive": old | {"moving": True}}):
        options = make_runner(table | {"rig": rig, "rate_hz": 30}).options
        assert (options.stereo, options.speed, options.goal) == ("search", 0.3, "4,0")


def test_a_car_that_was_blind_for_a_while(tmp_path):
    """As the loop of a car does: no frames, then frames that are not trusted, then a navigator that begins anew."""
    runner, still = NavigatorRunner(CHOICE, RIG, 30.0), DriveCommand(0.0, 0.0)
    with Recorder(tmp_path / "r", configuration(CHOICE, RIG, 30.0), when_full="wait") as recorder:
        observe, interrupted = RecordSteps(recorder), False
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
    recording = open_recording(tmp_path / "r")
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
    with Recorder(tmp_path / "r", loop.runner.configuration(), when_full="wait") as recorder:
        loop.observers += [RecordSteps(recorder), lambda step: anew.append(step.restarted)]
        loop.observers.append(lambda step: loop.safe.emergency("a key") if step.number == 20 else None)
        loop.observers.append(lambda step: loop.safe.resume() if step.number == 40 else None)
        assert loop.run(88.5 / 30) == 90
    assert 20 < sum(anew) < 60
    recording = open_recording(tmp_path / "r")
    steps = list(recording.steps())
    assert steps[30].standing == "emergency stop: a key"
    assert steps[30].telemetry["battery_v"] == 7.4
    assert steps[30].telemetry["link"] is None
    for mapping in (False, True):
        result = replay(recording, make_runner(recording.configuration, mapping))
        assert (result.steps, result.same) == (88, 88)
