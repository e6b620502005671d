"""Walking through a car, and driving it: what is asked, and what is said of it."""

from __future__ import annotations

import contextlib
import json
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.utils.packages import toml_file
from ndtorch.utils.toml import read_toml
from ndtorch_robot.commands.check import Check
from ndtorch_robot.commands.run import with_disturbance, world
from ndtorch_robot.run_config import RunConfig

SUMMARY = {"steps": 3, "late": 0, "faults": [], "standing": None}


class Car:
    """A car that is told for how long it is to drive, and does not."""

    def __init__(self) -> None:
        self.safe, self.ended, self.observers = SimpleNamespace(), threading.Event(), []
        self.runner, self.cameras = SimpleNamespace(configuration=dict), SimpleNamespace()
        self.asked: list[float | None] = []
        self.go = False

    def run(self, seconds: float | None) -> None:
        self.asked.append(seconds)

    def summary(self) -> dict[str, object]:
        return dict(SUMMARY)


@pytest.fixture
def car(monkeypatch: pytest.MonkeyPatch) -> Car:
    made = Car()

    @contextlib.contextmanager
    def opened(config: RunConfig, report: Any, go: bool) -> Iterator[Car]:
        made.go = go
        yield made

    monkeypatch.setattr("ndtorch_robot.run.open_car", opened)
    monkeypatch.setattr("ndtorch_robot.run.real_time_priority", lambda report: None)
    monkeypatch.setattr("ndtorch_robot.emergency.emergency_stops", lambda *_: contextlib.nullcontext())
    return made


def test_the_summary_is_one_object_or_one_line_each(car: Car, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "sim", "--seconds", "2", "--go", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out) == SUMMARY
    assert "ready; " in err
    assert (car.asked, car.go) == ([2.0], True)
    assert main(["run", "sim"]) == 0
    assert capsys.readouterr().out.splitlines() == [f"{key}: {value}" for key, value in SUMMARY.items()]
    assert (car.asked[-1], car.go) == (None, False)


def test_a_disturbance_goes_into_the_simulated_world() -> None:
    config = read_toml(toml_file(Path("sim"), "ndtorch_robot", "configs"), RunConfig)
    assert config.simulation is not None
    changed = with_disturbance(config, "noise")
    assert changed.simulation is not None
    assert (changed.simulation.disturbance, config.simulation.disturbance) == ("noise", "")
    with pytest.raises(InputError, match="this car has cameras"):
        with_disturbance(read_toml(toml_file(Path("maxstone8"), "ndtorch_robot", "configs"), RunConfig), "noise")


def test_cameras_know_nothing_of_collisions(car: Car) -> None:
    assert world(car) == {}  # type: ignore[arg-type]


class Closed:
    closed = False

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def drive(monkeypatch: pytest.MonkeyPatch) -> Closed:
    """A link on which the directions are wrong twice, and all else is right."""
    made = Closed()
    monkeypatch.setattr("ndtorch_robot.link.open_link", lambda *_: made)
    monkeypatch.setattr("ndtorch_robot.safety.SafeDrive", lambda *_, **__: None)
    monkeypatch.setattr("ndtorch_robot.run.make_simulation", lambda config: None)
    monkeypatch.setattr(Check, "cameras", lambda *_: (True, True))
    monkeypatch.setattr(Check, "link", lambda *_: True)
    monkeypatch.setattr(Check, "directions", lambda *_: 2)
    monkeypatch.setattr(Check, "emergency", lambda *_: 0)
    return made


def test_json_tells_the_points_and_nothing_else(drive: Closed, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "sim", "--yes", "--json"]) == 1
    out, err = capsys.readouterr()
    right = {"cameras": True, "floor": True, "link": True, "directions": False, "emergency_stop": True}
    assert json.loads(out) == right | {"not_right": 2}
    assert "Are all wheels off the ground? yes" in err
    assert drive.closed


def test_the_end_of_the_input_is_a_no(
    drive: Closed, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def ended() -> str:
        raise EOFError

    monkeypatch.setattr("builtins.input", ended)
    assert main(["check", "sim"]) == 1
    out, err = capsys.readouterr()
    assert "Are all wheels off the ground? [y/n]" in out
    assert err == "put the car on a block first\n"
    assert drive.closed


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler (cc)")
def test_the_firmware_passes(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """In simulated time: directions, speeds and the emergency stop of the board's own code."""
    assert main(["check", "sim", "--yes", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["not_right"] == 0
