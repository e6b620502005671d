"""The walk through a car: what is asked, and what is told of it."""

from __future__ import annotations

import json
import shutil

import pytest

from ndtorch.cli.commands import main
from ndtorch_robot.commands.check import Check


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
