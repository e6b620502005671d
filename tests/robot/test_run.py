"""`ndtorch run` and `ndtorch check` in a simulated world."""

import json
import shutil
from contextlib import nullcontext
from pathlib import Path

import pytest

from ndtorch.cli.commands import main
from ndtorch_robot.commands.check import Check

needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler (cc)")


@pytest.fixture
def car(tmp_path):
    """A car in simulated time."""
    file = tmp_path / "car.toml"
    file.write_text(
        'board_name = "maxston8"\nsimulation = {arena = "curve", seed = 11}\nnavigation = {controller = "published"}\n'
    )
    return str(file)


def test_a_drive_that_goes_well(car, capsys):
    assert main(["run", car, "--go", "--seconds", "2"]) == 0
    out, err = capsys.readouterr()
    assert "started" in err
    assert "fault" not in out + err
    assert "{" not in out
    assert "61 steps" in out.splitlines()[0]


def test_a_car_stands_without_go_and_faults_are_named(car, capsys):
    assert main(["run", car, "--seconds", "1", "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["distance_m"], summary["standing"], summary["faults"]) == (0.0, "not started", [])
    file = Path(car)
    file.write_text(file.read_text().replace("seed = 11", 'seed = 11, disturbance = "lost_ratio=0.9"'))
    assert main(["run", car, "--go", "--seconds", "1"]) == 0
    assert "fault at " in capsys.readouterr().out


@needs_compiler
def test_the_firmware_passes_the_check(tmp_path, capsys):
    """In simulated time: directions, speeds and the emergency stop of the board's own code."""
    file = tmp_path / "hosted.toml"
    file.write_text('link = {kind = "hosted-board"}\nsimulation = {}\n')
    assert main(["check", str(file), "--json"]) == 0
    points = dict.fromkeys(("cameras", "link", "directions", "emergency_stop"), True)
    assert json.loads(capsys.readouterr().out) == points


def test_the_end_of_the_input_counts_as_no(capsys, monkeypatch):
    monkeypatch.setattr("builtins.input", lambda: (_ for _ in ()).throw(EOFError))
    monkeypatch.setattr("ndtorch_robot.run.open_drive", lambda *_: nullcontext((None, None, None)))
    monkeypatch.setattr(Check, "link", lambda *_: True)
    assert main(["check", "maxstone8"]) == 1
    assert capsys.readouterr().err == "put the car on a block first\n"


def test_a_file_with_body_and_rig_drives_and_a_run_says_what_it_lacks(tmp_path, capsys):
    """The file that docs/robot/robots.md shows."""
    text = (Path(__file__).parents[2] / "docs" / "robot" / "robots.md").read_text()
    (tmp_path / "robot.toml").write_text(text.split("```toml\n")[1].split("```")[0])
    robot = str(tmp_path / "robot.toml")
    assert main(["drive", "--robot", robot, "--seconds", "0.1", "--out", str(tmp_path / "out")]) == 0
    assert main(["run", robot, "--go"]) == 2
    assert "[cameras] and [link], or the table [simulation]" in capsys.readouterr().err
